"""The sensor shows nothing beyond its range."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid_bench.mechanics.effect import POSITIVE, Effect, Knob


@dataclass(frozen=True)
class SensorClipping(Effect):
    """clip(y, -limit, limit)"""

    name: ClassVar[str] = "sensor_clipping"
    path: ClassVar[str] = "sensor"
    equation: ClassVar[str] = "clip(y, -limit, limit)"
    reveals: ClassVar[str] = "a smaller amplitude"
    held: ClassVar[tuple[str, ...]] = ("limit",)
    knobs: ClassVar[dict[str, Knob]] = {
        "limit": Knob("m", POSITIVE),
    }

    dof: int | tuple[int, int] | None = 0
    limit: float = 1.0

    def sense(self, y, t, channels):
        """y (N, ny) -> what is recorded."""
        y = np.array(y)
        y[:, channels] = np.clip(y[:, channels], -self.limit, self.limit)
        return y
