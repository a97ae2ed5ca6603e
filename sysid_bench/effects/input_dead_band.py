"""The drive ignores small inputs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid_bench.mechanics.effect import POSITIVE, Effect, Knob, Seen, Suspect


@dataclass(frozen=True)
class InputDeadBand(Effect):
    """u - clip(u, -width, width)"""

    name: ClassVar[str] = "input_dead_band"
    path: ClassVar[str] = "actuator"
    equation: ClassVar[str] = "u - clip(u, -width, width)"
    reveals: ClassVar[str] = "small inputs from rest"
    knobs: ClassVar[dict[str, Knob]] = {
        "width": Knob("N", POSITIVE),
    }

    dof: int | tuple[int, int] | None = 0
    width: float = 0.1

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.changed("width", f * seen.u_rms) for f in (0.15, 0.3, 0.6, 1.0)]

    def act(self, stages, h, channels, memory):
        """Stage values (S, 3, nu) of small steps of h seconds -> the same, limited; needs no memory."""
        stages = np.array(stages)
        part = stages[:, :, channels]
        stages[:, :, channels] = part - np.clip(part, -self.width, self.width)
        return stages, None
