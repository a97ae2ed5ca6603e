"""scalar plant, T, N -> how well the difference equation can be told from its own data (Kapucu and Baysec 6.2).

At T = pi / omega_d both discrete poles are -exp(-c T / 2 m), and so is the zero: one factor cancels, and any
common factor (z + e) fits the data as well. The least-squares matrix (9) is then singular.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.difference import regressors
from sysid_bench.mechanics.scalar import SECOND_ORDER, exact_equation, poles_and_zero, simulate
from sysid_bench.nouns import Plant, Sampling


@dataclass(frozen=True)
class Identifiability:
    """Noise-free least-squares matrix X (N - 2, 5) of a random binary force.

    Returns condition (of X), pole_zero_distance (from the zero -b2 / b1 to the nearest pole), zero, pole_real
    and pole_imag (of that pole) and b1_share (part of the weakest direction of theta that lies on b1: 0 where
    b1 is determined though X is singular). Raises InputError on a plant that is not scalar.
    """

    amplitude_N: float = 0.5

    def compute(self, plant: Plant, sampling: Sampling, rng: np.random.Generator) -> dict[str, float]:
        equation = exact_equation(plant, sampling.h_s)
        u = self.amplitude_N * rng.choice([-1.0, 1.0], (sampling.N, 1))
        X = regressors(u, simulate(equation, u), SECOND_ORDER)
        _, singular, directions = np.linalg.svd(X)
        poles, zero = poles_and_zero(equation)
        nearest = poles[np.argmin(np.abs(poles - zero))]
        return {
            "condition": float(singular[0] / singular[-1]),
            "pole_zero_distance": float(abs(nearest - zero)),
            "zero": zero,
            "pole_real": float(nearest.real),
            "pole_imag": float(nearest.imag),
            "b1_share": float(abs(directions[-1, 3])),
        }
