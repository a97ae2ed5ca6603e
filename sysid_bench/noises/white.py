"""White Gaussian measurement noise at a signal-to-noise ratio per channel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.snr import noise_variance
from sysid_bench.nouns import Array


@dataclass(frozen=True)
class White:
    """snr_db: 10 log10 of var(noise-free output) over var(noise), dB; one number, or one per channel."""

    snr_db: float | list[float] = 15.0

    def apply(self, y: Array, h: float, rng: np.random.Generator) -> tuple[Array, Array]:
        variance = noise_variance(y, self.snr_db)
        return y + np.sqrt(variance) * rng.standard_normal(y.shape), variance
