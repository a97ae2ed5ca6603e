"""The sensor repeats its last value for a while."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid_bench.mechanics.effect import NOT_NEGATIVE, Effect, Knob


@dataclass(frozen=True)
class StuckSensor(Effect):
    """y(start) from start to start + duration"""

    name: ClassVar[str] = "stuck_sensor"
    path: ClassVar[str] = "sensor"
    equation: ClassVar[str] = "y(start) from start to start + duration"
    reveals: ClassVar[str] = "the same record again"
    held: ClassVar[tuple[str, ...]] = ("start", "duration")
    knobs: ClassVar[dict[str, Knob]] = {
        "start": Knob("s", NOT_NEGATIVE),
        "duration": Knob("s", NOT_NEGATIVE),
    }

    dof: int | tuple[int, int] | None = 0
    start: float = 1.0
    duration: float = 1.0

    def sense(self, y, t, channels):
        """y (N, ny) -> what is recorded. t counts from the first sample."""
        y, since = np.array(y), t - t[0]
        stuck = np.flatnonzero((since >= self.start) & (since < self.start + self.duration))
        if len(stuck) and len(t) > 1:
            y[stuck[:, None], channels] = y[stuck[0], channels]
        return y
