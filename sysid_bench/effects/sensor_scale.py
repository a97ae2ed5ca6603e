"""The sensor's gain is wrong."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid_bench.mechanics.effect import POSITIVE, Effect, Knob


@dataclass(frozen=True)
class SensorScale(Effect):
    """factor * y"""

    name: ClassVar[str] = "sensor_scale"
    path: ClassVar[str] = "sensor"
    equation: ClassVar[str] = "factor * y"
    reveals: ClassVar[str] = "a known displacement, or a second sensor"
    knobs: ClassVar[dict[str, Knob]] = {
        "factor": Knob("1", POSITIVE),
    }

    dof: int | tuple[int, int] | None = 0
    factor: float = 1.1

    def sense(self, y, t, channels):
        """y (N, ny) -> what is recorded."""
        y = np.array(y)
        y[:, channels] *= self.factor
        return y
