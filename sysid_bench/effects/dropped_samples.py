"""Samples are lost and the last value is shown again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid_bench.mechanics.effect import NOT_NEGATIVE, Effect, Knob


@dataclass(frozen=True)
class DroppedSamples(Effect):
    """y_k = y_(k-1) at a share of the samples"""

    name: ClassVar[str] = "dropped_samples"
    path: ClassVar[str] = "timing"
    equation: ClassVar[str] = "y_k = y_(k-1) at a share of the samples"
    reveals: ClassVar[str] = "time stamps from the sensor itself"
    held: ClassVar[tuple[str, ...]] = ("share", "seed")
    knobs: ClassVar[dict[str, Knob]] = {
        "share": Knob("1", (0.0, 1.0)),
        "seed": Knob("1", NOT_NEGATIVE),
    }

    dof: int | tuple[int, int] | None = None
    share: float = 0.01
    seed: float = 0.0

    def sense(self, y, t, channels):
        """y (N, ny) -> what is recorded."""
        y = np.array(y)
        lost = np.random.default_rng(int(self.seed)).random(len(y)) < self.share
        lost[0] = False
        kept = np.maximum.accumulate(np.where(lost, 0, np.arange(len(y))))
        y[:, channels] = y[kept][:, channels]
        return y
