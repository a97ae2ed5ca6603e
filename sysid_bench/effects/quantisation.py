"""The sensor counts in steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid_bench.mechanics.effect import POSITIVE, Effect, Knob


@dataclass(frozen=True)
class Quantisation(Effect):
    """step * round(y / step)"""

    name: ClassVar[str] = "quantisation"
    path: ClassVar[str] = "sensor"
    equation: ClassVar[str] = "step * round(y / step)"
    reveals: ClassVar[str] = "a larger amplitude"
    held: ClassVar[tuple[str, ...]] = ("step",)
    knobs: ClassVar[dict[str, Knob]] = {
        "step": Knob("m", POSITIVE),
    }

    dof: int | tuple[int, int] | None = 0
    step: float = 0.01

    def sense(self, y, t, channels):
        """y (N, ny) -> what is recorded."""
        y = np.array(y)
        y[:, channels] = self.step * np.round(y[:, channels] / self.step)
        return y
