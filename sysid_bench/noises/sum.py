"""Several noises together, as in white noise in front of a converter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid_bench.nouns import Array


@dataclass(frozen=True)
class Sum:
    """parts: noises. Each SNR counts against the noise-free output; converters round what came before them."""

    parts: list[Any]

    def apply(self, y: Array, h: float, rng: np.random.Generator) -> tuple[Array, Array]:
        """Variance: the sum of the parts'."""
        measured, total = np.array(y), np.zeros(y.shape[1])
        for part in self.parts:
            if getattr(part, "rounds", False):
                measured, variance = part.apply(measured, h, rng)
            else:
                noisy, variance = part.apply(y, h, rng)
                measured = measured + (noisy - y)
            total = total + variance
        return measured, total
