"""M, D, K, small step -> its exact propagation, for forces that are polynomials of time within it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from sysid_bench.mechanics.exponential import balanced
from sysid_bench.nouns import Array

MOST_SQUARINGS = 52  # each loses a bit of the 53 of a double


@dataclass(frozen=True, eq=False)
class Step:
    """Exact propagation over one small step of h seconds: x1 = Ad x0 + force response.

    start, middle, end (nx, n): a force on each DOF that is quadratic through its values there;
    falling, rising (nx, n): a force that runs linearly from 1 to 0, from 0 to 1
    """

    Ad: Array
    start: Array
    middle: Array
    end: Array
    falling: Array
    rising: Array
    inverse_mass: Array


def matrix_exponential(A: Array) -> Array:
    """exp(A) by scaling and squaring of its Taylor series (order 16, scaled norm below 1/2), in balanced units.

    Not a number where the norm is so large, in any units, that squaring leaves no digit.
    """
    A, units = balanced(A)
    scale = max(0, int(np.ceil(np.log2(max(np.linalg.norm(A, 1), 1e-300)))) + 1)
    if scale > MOST_SQUARINGS:
        return np.full_like(A, np.nan)
    A = A / 2.0**scale
    total = term = np.eye(len(A))
    for k in range(1, 17):
        term = term @ A / k
        total = total + term
    for _ in range(scale):
        total = total @ total
    return units[:, None] * total / units


def exact_step(M: Array, D: Array, K: Array, h: float) -> Step:
    """Propagation over h with polynomial forces (Van Loan 1978: one exponential of the augmented matrix).

    Not a number where the motion is too fast for the step to be told in double precision. The last few are kept: many
    runs differ in their start or input alone.
    """
    M, D, K = (np.asarray(X, dtype=float) for X in (M, D, K))
    return _exact_step(M.tobytes(), D.tobytes(), K.tobytes(), len(M), float(h))


@lru_cache(maxsize=8)
def _exact_step(mass: bytes, damping: bytes, stiffness: bytes, n: int, h: float) -> Step:
    M, D, K = (np.frombuffer(X).reshape(n, n) for X in (mass, damping, stiffness))
    inverse = np.linalg.inv(M)
    big = np.zeros((5 * n, 5 * n))
    big[:n, n : 2 * n] = np.eye(n)
    big[n : 2 * n, :n], big[n : 2 * n, n : 2 * n] = -inverse @ K, -inverse @ D
    big[n : 2 * n, 2 * n : 3 * n] = inverse
    big[2 * n : 3 * n, 3 * n : 4 * n] = np.eye(n) / h  # time counted in steps: tau in [0, 1]
    big[3 * n : 4 * n, 4 * n :] = np.eye(n) / h
    E = matrix_exponential(big * h)[: 2 * n]
    B0, B1, B2 = E[:, 2 * n : 3 * n], E[:, 3 * n : 4 * n], 2 * E[:, 4 * n :]  # responses to 1, tau, tau^2
    return Step(
        E[:, : 2 * n],
        B0 - 3 * B1 + 2 * B2,
        4 * (B1 - B2),
        2 * B2 - B1,
        B0 - B1,
        B1,
        inverse,
    )
