"""spectra -> M, D, K by one linear least squares in the band: the start that needs no guess.

Equation error P(s) Y - L U - polynomial(s), low-pass filtered by second-order poles at the output's rms
frequency; the known power of white noise is taken out of the normal matrix, so that its bias is too.
"""

from __future__ import annotations

import numpy as np

from sysid_bench.mechanics import normal_equations as ne
from sysid_bench.mechanics.hold_spectra import hold_spectrum
from sysid_bench.mechanics.in_band import Spectra
from sysid_bench.mechanics.response import Maps
from sysid_bench.nouns import Array, Complex, NotApplicable

FILTER_DAMPING = 1.4


def equation_error_normal(
    data: Spectra, maps: Maps, F: int, noise_power: Array | None = None
) -> tuple[Array, Array]:
    """H (3q, 3q), g (3q,) of the equation-error least squares, the boundary terms eliminated.

    noise_power (ny,): E|noise|^2 per bin to take out, None for plain least squares. Raises NotApplicable
    where not every degree of freedom has its own sensor.
    """
    if maps.C.shape[0] < maps.n or np.linalg.matrix_rank(maps.C) < maps.n:
        raise NotApplicable("the linear start needs a sensor on every degree of freedom.")
    first = 1 if maps.power else 0
    s = 1j * data.omega[first:F]
    back = np.linalg.pinv(maps.C)
    Q = (data.Y[first:F] @ back.T) / (s**maps.power)[:, None]
    f, scale = _filter(data.omega[first:F], Q)
    W = (np.abs(f) ** 2)[:, None, None] * np.diag(1 / scale**2)
    drive = (data.U[first:F] * hold_spectrum(data.omega[first:F], data.h, data.hold)[:, None]) @ maps.L.T
    Omega = np.conj(Q)[:, :, None] * Q[:, None, :]
    if noise_power is not None:
        Omega = Omega - (back * noise_power) @ back.T / (np.abs(s) ** (2 * maps.power))[:, None, None]
    H = ne.information(W, Omega, data.omega[first:F])
    weighted = -(np.abs(f) ** 2)[:, None] * drive / scale**2
    g = ne.gradient(s, weighted, Q)
    return _without_boundary(data.weight[first:F], s, W, weighted, Q, maps.power, H, g)


def _filter(omega: Array, Q: Complex) -> tuple[Complex, Array]:
    scale = np.sqrt((np.abs(Q) ** 2).mean(axis=0))
    power = (np.abs(Q / scale) ** 2).sum(axis=1)
    corner = np.sqrt((omega**2 * power).sum() / power.sum())
    s = 1j * omega
    return 1 / (s * s + FILTER_DAMPING * corner * s + corner**2), scale


def _without_boundary(weight, s, W, weighted, Q, power, H, g) -> tuple[Array, Array]:
    """Eliminate the polynomial of the record's ends: s^2 (folding), s, 1 and one 1/s per integration."""
    n = Q.shape[1]
    columns = np.stack([s ** (2 - p) for p in range(3 + power)], axis=1) * weight[:, None]
    columns = columns / np.sqrt((np.abs(columns) ** 2).sum(axis=0))
    terms = columns.shape[1]
    wdiag = np.einsum("fii->fi", W).real
    back = (wdiag[:, :, None, None] * np.eye(n)[None, :, :, None]) * columns[:, None, None, :]
    X = ne.cross(s, Q, back.reshape(len(s), n, n * terms)).real
    A = np.zeros((n, terms, n, terms))
    slope = np.zeros((n, terms))
    for i in range(n):
        A[i, :, i, :] = (np.conj(columns).T * wdiag[:, i] @ columns).real
        slope[i] = (np.conj(columns).T @ weighted[:, i]).real
    half = np.linalg.lstsq(A.reshape(n * terms, -1), np.column_stack([X.T, slope.ravel()]), rcond=1e-13)[0]
    return H - X @ half[:, :-1], g - X @ half[:, -1]
