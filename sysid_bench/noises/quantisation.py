"""An analogue-to-digital converter: the output rounded to its levels and clipped at its range."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid_bench.mechanics.signals import per_channel
from sysid_bench.nouns import Array, InputError


@dataclass(frozen=True)
class Quantisation:
    """bits: of the converter, 2^bits levels over -range ... +range
    range: in the output's unit, one number or one per channel; null: the peak of each channel
    """

    bits: int = 12
    range: float | list[float] | None = None

    rounds: ClassVar[bool] = True  # acts on what it is given, noise included (see sum)

    def __post_init__(self) -> None:
        if not 1 <= self.bits <= 52:
            raise InputError(f"noise.bits must be 1 to 52; got {self.bits!r}.")

    def apply(self, y: Array, h: float, rng: np.random.Generator) -> tuple[Array, Array]:
        """Variance: mean square of the rounding and clipping errors of this very record."""
        peak = (
            np.abs(y).max(axis=0)
            if self.range is None
            else per_channel(self.range, y.shape[1], "noise.range")
        )
        if np.any(peak < 0) or (self.range is not None and np.any(peak == 0)):
            raise InputError(f"noise.range must be positive; got {self.range!r}.")
        half = 2 ** (self.bits - 1)
        step = np.where(peak > 0, peak, 1.0) / half
        rounded = step * np.clip(np.rint(y / step), -half, half - 1)
        return rounded, np.mean((rounded - y) ** 2, axis=0)
