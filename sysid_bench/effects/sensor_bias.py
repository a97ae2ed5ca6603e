"""The sensor shows a constant too much."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid_bench.mechanics.effect import Effect, Knob


@dataclass(frozen=True)
class SensorBias(Effect):
    """y + bias"""

    name: ClassVar[str] = "sensor_bias"
    path: ClassVar[str] = "sensor"
    equation: ClassVar[str] = "y + bias"
    reveals: ClassVar[str] = "a stretch at rest"
    knobs: ClassVar[dict[str, Knob]] = {
        "bias": Knob("m"),
    }

    dof: int | tuple[int, int] | None = 0
    bias: float = 0.1

    def sense(self, y, t, channels):
        """y (N, ny) -> what is recorded."""
        y = np.array(y)
        y[:, channels] += self.bias
        return y
