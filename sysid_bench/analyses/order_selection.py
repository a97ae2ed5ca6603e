"""plant, noise -> the number of degrees of freedom that a record of it shows, and whether it is right."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from sysid_bench.mechanics.order_selection import number_of_dofs
from sysid_bench.mechanics.simulate import simulate
from sysid_bench.mechanics.snr import noise_variance
from sysid_bench.nouns import Plant, Record, Sampling


@dataclass(frozen=True)
class OrderSelection:
    """knot_spacing_s of the cubic noise force, s; snr_db, dB; beyond: degrees of freedom tried above the truth.

    Returns n (chosen), right (1 or 0) and off (chosen minus true).
    """

    knot_spacing_s: float = 1.0
    snr_db: float = 15.0
    beyond: int = 3

    def compute(self, plant: Plant, sampling: Sampling, rng: np.random.Generator) -> dict[str, float]:
        """Raises Diverged or NotApplicable where no order can be fitted."""
        t = sampling.h_s * np.arange(sampling.N)
        count = int(t[-1] / self.knot_spacing_s) + 4
        u = CubicSpline(self.knot_spacing_s * np.arange(count), rng.standard_normal((count, plant.nu)))(t)
        y = simulate(plant, u, sampling.h_s, "cubic")
        y = y + rng.standard_normal(y.shape) * np.sqrt(noise_variance(y, self.snr_db))
        n = number_of_dofs(Record(t, u, y, "cubic"), plant.n + self.beyond).n
        return {"n": float(n), "right": float(n == plant.n), "off": float(n - plant.n)}
