"""plant of one degree of freedom, h -> its exact difference equation, and a difference equation's response."""

from __future__ import annotations

import numpy as np
from scipy.signal import freqz, lfilter

from sysid_bench.mechanics.conversion import zoh_coefficients
from sysid_bench.mechanics.difference import DifferenceEquation, Orders
from sysid_bench.nouns import Array, InputError, Plant

SECOND_ORDER = Orders(na=2, nb=3, nk=0)  # b0 free, as in Kapucu and Baysec (1997), (4)


def exact_equation(plant: Plant, h: float) -> DifferenceEquation:
    """The zero-order-hold equation of a plant with one DOF. Raises InputError for more."""
    if plant.n != 1:
        raise InputError(f"this study is for one degree of freedom; the plant has {plant.n}.")
    named = zoh_coefficients(plant.mass, plant.damping, plant.stiffness, plant.input_map, plant.output_map, h)
    a, b = ([named[name] for name in names] for names in (("a1", "a2"), ("b0", "b1", "b2")))
    return DifferenceEquation(np.reshape(a, (2, 1, 1)), np.reshape(b, (3, 1, 1)))


def poles_and_zero(equation: DifferenceEquation) -> tuple[np.ndarray, float]:
    """Discrete poles (na,) and the zero -b2 / b1 of a second-order equation with b0 = 0."""
    return np.linalg.eigvals(equation.companion), float(-equation.b[2, 0, 0] / equation.b[1, 0, 0])


def frequency_response(equation: DifferenceEquation, omega: Array, h: float) -> np.ndarray:
    """Complex response (k,) at omega (k,) rad/s of a scalar equation sampled every h s."""
    return freqz(equation.b[:, 0, 0], np.r_[1.0, equation.a[:, 0, 0]], worN=omega * h)[1]


def simulate(equation: DifferenceEquation, u: Array) -> Array:
    """Free-run output (N, 1) of a scalar equation from rest under u (N, 1)."""
    return lfilter(equation.b[:, 0, 0], np.r_[1.0, equation.a[:, 0, 0]], u, axis=0)
