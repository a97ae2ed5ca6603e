"""The sensor's zero wanders."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid_bench.mechanics.effect import Effect, Knob


@dataclass(frozen=True)
class SensorDrift(Effect):
    """y + rate * t + curvature * t^2"""

    name: ClassVar[str] = "sensor_drift"
    path: ClassVar[str] = "sensor"
    equation: ClassVar[str] = "y + rate * t + curvature * t^2"
    reveals: ClassVar[str] = "rest before and after"
    knobs: ClassVar[dict[str, Knob]] = {
        "rate": Knob("m/s"),
        "curvature": Knob("m/s^2"),
    }

    dof: int | tuple[int, int] | None = 0
    rate: float = 0.01
    curvature: float = 0.0

    def sense(self, y, t, channels):
        """y (N, ny) -> what is recorded."""
        y = np.array(y)
        y[:, channels] += (self.rate * t + self.curvature * t**2)[:, None]
        return y
