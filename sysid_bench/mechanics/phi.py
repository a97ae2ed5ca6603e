"""z -> the phi functions of exponential integrators, and divided differences of any function."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from math import factorial

import numpy as np

from sysid_bench.nouns import Complex

TERMS = 30
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


def phi(z: Complex, highest: int) -> list[Complex]:
    """[phi_0, ..., phi_highest] at z: phi_0 = exp, phi_{p+1}(z) = (phi_p(z) - 1/p!) / z, all entire."""
    z = np.asarray(z, dtype=complex)
    small = np.abs(z) < 2.0
    if small.all():
        return _series(z, highest)
    series = _series(np.where(small, z, 0.0), highest)
    safe, upward = np.where(small, 1.0, z), [np.exp(z)]
    for p in range(highest):
        upward.append((upward[-1] - 1 / factorial(p)) / safe)
    return [np.where(small, a, b) for a, b in zip(series, upward)]


@lru_cache(maxsize=16)
def _reciprocals(highest: int) -> Complex:
    return np.array([1 / factorial(m + highest) for m in range(TERMS)], dtype=complex)


def _series(z: Complex, highest: int) -> list[Complex]:
    """Taylor for the highest, then downwards, which loses nothing for small z."""
    powers = np.ones((*z.shape, TERMS), dtype=complex)
    powers[..., 1:] = z[..., None]
    values: list[Complex] = [np.cumprod(powers, axis=-1) @ _reciprocals(highest)]
    for p in reversed(range(highest)):
        values.append(values[-1] * z + 1 / factorial(p))
    return values[::-1]


def divided_difference(
    f: Callable[[Complex], Complex], slope: Callable[[Complex], Complex], a: Complex, b: Complex
) -> Complex:
    """f[a, b] = (f(a) - f(b)) / (a - b), or slope(a) where they meet, without cancellation for close a, b.

    f and slope may return leading axes before those of their argument. Close pairs integrate the slope from
    b to a by 8-point Gauss-Legendre: exact to rounding for |a - b| <= 0.5 and entire or remote-pole functions.
    """
    a, b = np.broadcast_arrays(np.asarray(a, complex), np.asarray(b, complex))
    far = np.abs(a - b) > 0.5
    quotient = (f(a) - f(b)) / np.where(far, a - b, 1.0)
    step = np.where(far, 0.0, a - b)
    mean = sum(0.5 * w * slope(b + 0.5 * (x + 1) * step) for x, w in zip(NODES, WEIGHTS))
    return np.where(far, quotient, mean)
