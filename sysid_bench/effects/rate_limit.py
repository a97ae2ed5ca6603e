"""The drive changes no faster than its limit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid_bench.mechanics.effect import POSITIVE, Effect, Knob, Seen, Suspect
from sysid_bench.mechanics.paths import rate_limited


@dataclass(frozen=True)
class RateLimit(Effect):
    """|du/dt| <= rate"""

    name: ClassVar[str] = "rate_limit"
    path: ClassVar[str] = "actuator"
    equation: ClassVar[str] = "|du/dt| <= rate"
    reveals: ClassVar[str] = "steps, and slow ramps beside them"
    knobs: ClassVar[dict[str, Knob]] = {
        "rate": Knob("N/s", POSITIVE),
    }

    dof: int | tuple[int, int] | None = 0
    rate: float = 10.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.changed("rate", f * seen.u_step / seen.h) for f in (0.15, 0.3, 0.5, 0.75)]

    def act(self, stages, h, channels, memory):
        """Stage values (S, 3, nu) -> the same, slowed; memory (nu,): the drive's force so far."""
        stages, part = np.array(stages), stages[:, :, channels]
        start = part[0, 0] if memory is None else memory
        limited = rate_limited(np.ascontiguousarray(part), self.rate * h / 2, start)
        stages[:, :, channels] = limited
        return stages, limited[-1, 2].copy()
