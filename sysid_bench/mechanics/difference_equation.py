"""theta, u -> y, and y, u -> the least-squares matrix of y_k + a1 y_k-1 + .. = b0 u_k + b1 u_k-1 + ..

theta (2 order + 1,) = (a1 .. a_order, b0 .. b_order), as (4) of Kapucu and Baysec (1997).
"""

from __future__ import annotations

import numpy as np
from scipy.signal import freqz, lfilter

from sysid_bench.mechanics.conversion import zoh_coefficients
from sysid_bench.nouns import Array, InputError, Plant


def scalar_theta(plant: Plant, h: float) -> Array:
    """(a1, a2, b0, b1, b2) of a plant of one degree of freedom under an exact zero-order hold of h s."""
    if plant.n != 1:
        raise InputError(f"this study is for one degree of freedom; the plant has {plant.n}.")
    named = zoh_coefficients(plant.mass, plant.damping, plant.stiffness, plant.input_map, plant.output_map, h)
    return np.array([named[name] for name in ("a1", "a2", "b0", "b1", "b2")])


def split(theta: Array) -> tuple[Array, Array]:
    """Numerator (order + 1,) and denominator (order + 1,) in z^-1."""
    order = len(theta) // 2
    return theta[order:], np.concatenate([[1.0], theta[:order]])


def simulate(theta: Array, u: Array) -> Array:
    """y (N,) from rest under u (N,)."""
    return lfilter(*split(theta), u)


def frequency_response(theta: Array, omega: Array, h: float) -> np.ndarray:
    """Complex response (k,) at omega (k,) rad/s."""
    return freqz(*split(theta), worN=omega * h)[1]


def least_squares_matrix(y: Array, u: Array, order: int) -> Array:
    """X of (9): rows -y_k-1 .. -y_k-order, u_k .. u_k-order for k = order .. N - 1."""
    N = len(y)
    past = [-y[order - j : N - j] for j in range(1, order + 1)]
    forces = [u[order - j : N - j] for j in range(order + 1)]
    return np.column_stack(past + forces)


def least_squares(y: Array, u: Array, order: int) -> Array:
    """theta that minimises the equation error, (12) with its transposes put right."""
    return np.linalg.lstsq(least_squares_matrix(y, u, order), y[order:], rcond=None)[0]
