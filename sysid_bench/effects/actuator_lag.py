"""The drive follows with a first-order lag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid_bench.mechanics.effect import POSITIVE, Effect, Knob, Seen, Suspect
from sysid_bench.mechanics.paths import lag


@dataclass(frozen=True)
class ActuatorLag(Effect):
    """time_constant * w' + w = u"""

    name: ClassVar[str] = "actuator_lag"
    path: ClassVar[str] = "actuator"
    equation: ClassVar[str] = "time_constant * w' + w = u"
    reveals: ClassVar[str] = "a band up to the inverse of the time constant; compare the gain"
    knobs: ClassVar[dict[str, Knob]] = {
        "time_constant": Knob("s", POSITIVE),
    }

    dof: int | tuple[int, int] | None = 0
    time_constant: float = 0.01

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.changed("time_constant", f / seen.omega_high) for f in (0.03, 0.08, 0.2, 0.5)]

    def act(self, stages, h, channels, memory):
        """Stage values (S, 3, nu) -> the same, lagging; memory (nu,): the drive's force so far."""
        stages, part = np.array(stages), stages[:, :, channels]
        start = np.zeros(len(channels)) if memory is None else memory
        lagged = lag(np.ascontiguousarray(part), h / self.time_constant, start)
        stages[:, :, channels] = lagged
        return stages, lagged[-1, 2].copy()
