"""hold, poles -> exact discrete poles and input weights; hold, samples -> the signals that drive them.

Between two samples a hold is a polynomial, u(t_k + r) = sum_j c_j[k] r^j, so each mode x' = lam x + u obeys
x[k+1] = exp(lam h) x[k] + sum_j g_j(lam) c_j[k] with g_j = j! h^(j+1) phi_(j+1)(lam h), exactly.
"""

from __future__ import annotations

from math import factorial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from sysid_bench.nouns import Array, InputError, NotApplicable

Complex = NDArray[np.complex128]
ORDER = {"zoh": 1, "foh": 2, "cubic": 4}
SERIES_TERMS = 24


def phi_functions(x: Complex, count: int) -> Complex:
    """phi_1 .. phi_count of x: phi_k(x) = sum_m x^m / (m + k)!, shape x.shape + (count,)."""
    x = np.asarray(x, dtype=complex)
    small = np.abs(x) < 1.0
    values = np.empty((*x.shape, count), dtype=complex)
    near, far = x[small], x[~small]
    powers = near[:, None] ** np.arange(SERIES_TERMS)
    for k in range(1, count + 1):
        values[small, k - 1] = powers @ [1 / factorial(m + k) for m in range(SERIES_TERMS)]
    last = np.exp(far)
    for k in range(count):
        last = (last - 1 / factorial(k)) / far
        values[~small, k] = last
    return values


def exact_rule(poles: Complex, h: float, hold: str) -> tuple[Complex, Complex]:
    """Discrete poles (nm,) and weights (nm, J) of the J signals of `drives`; a hold but bandlimited."""
    J = ORDER[hold]
    scale = np.array([factorial(j) * h ** (j + 1) for j in range(J)])
    return np.exp(poles * h), phi_functions(poles * h, J) * scale


def drives(u: Array, h: float, hold: str) -> Array:
    """Polynomial coefficients c_j[k] of the held input, (J, N, nu); zero in the last row, after the record."""
    c = np.zeros((ORDER[hold], *u.shape))
    if hold == "zoh":
        c[0, :-1] = u[:-1]
    elif hold == "foh":
        c[0, :-1], c[1, :-1] = u[:-1], np.diff(u, axis=0) / h
    else:
        if len(u) < 4:
            raise NotApplicable(f"a cubic hold needs at least 4 samples; the record has {len(u)}.")
        c[:, :-1] = CubicSpline(h * np.arange(len(u)), u).c[::-1]
    return c


def hold_spectrum(omega: Array, h: float, hold: str) -> Complex:
    """What the hold makes of a sampled complex exponential at omega (rad/s, also beyond Nyquist), of its DFT.

    cubic: the cardinal spline's 3 sinc^4 / (2 + cos omega h); bandlimited: one below Nyquist, zero beyond.
    """
    x = omega * h
    sinc = np.sinc(x / (2 * np.pi))
    if hold == "zoh":
        return sinc * np.exp(-0.5j * x)
    if hold == "foh":
        return (sinc**2).astype(complex)
    if hold == "cubic":
        return (3 * sinc**4 / (2 + np.cos(x))).astype(complex)
    if hold == "bandlimited":
        return (np.abs(x) <= np.pi * (1 + 1e-12)).astype(complex)
    raise InputError(f"hold must be one of zoh, foh, cubic, bandlimited; got {hold!r}.")
