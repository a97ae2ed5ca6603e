"""The drive gives no more than its limit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid_bench.mechanics.effect import POSITIVE, Effect, Knob, Seen, Suspect


@dataclass(frozen=True)
class Saturation(Effect):
    """clip(u, -limit, limit)"""

    name: ClassVar[str] = "saturation"
    path: ClassVar[str] = "actuator"
    equation: ClassVar[str] = "clip(u, -limit, limit)"
    reveals: ClassVar[str] = "an input well below the limit and one above"
    knobs: ClassVar[dict[str, Knob]] = {
        "limit": Knob("N", POSITIVE),
    }

    dof: int | tuple[int, int] | None = 0
    limit: float = 1.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.changed("limit", f * seen.u_max) for f in (0.35, 0.5, 0.65, 0.8, 0.92)]

    def act(self, stages, h, channels, memory):
        """Stage values (S, 3, nu) of small steps of h seconds -> the same, limited; needs no memory."""
        stages = np.array(stages)
        part = stages[:, :, channels]
        stages[:, :, channels] = np.clip(part, -self.limit, self.limit)
        return stages, None
