"""spectra -> M, D, K by one linear least squares in the band: the start that needs no guess.

Equation error P(s) Y - L U - polynomial(s), low-pass filtered by second-order poles at the output's rms frequency.
"""

from __future__ import annotations

import numpy as np

from sysid_bench.mechanics import normal_equations as ne
from sysid_bench.mechanics.hold_spectra import hold_spectrum
from sysid_bench.mechanics.in_band import Spectra, squared
from sysid_bench.mechanics.kronecker import real_products, with_ends
from sysid_bench.mechanics.response import Maps
from sysid_bench.nouns import Array, Complex, NotApplicable

FILTER_DAMPING = 1.4


def equation_error_normal(data: Spectra, maps: Maps, F: int) -> tuple[Array, Array]:
    """H (3q, 3q), g (3q,) of the equation-error least squares, without the polynomial of the record's ends: s^2 (folding),
    s, 1 and one 1/s per integration.

    Raises NotApplicable where not every degree of freedom has its own sensor.
    """
    if maps.C.shape[0] < maps.n or np.linalg.matrix_rank(maps.C) < maps.n:
        raise NotApplicable("the linear start needs a sensor on every degree of freedom.")
    first = 1 if maps.power else 0
    s = 1j * data.omega[first:F]
    Q = (data.Y[first:F] @ np.linalg.pinv(maps.C).T) / (s**maps.power)[:, None]
    f, scale = _filter(data.omega[first:F], Q)
    drive = (data.U[first:F] * hold_spectrum(data.omega[first:F], data.h, data.hold)[:, None]) @ maps.L.T
    w, ends = data.weight[first:F], tuple(range(2, -1 - maps.power, -1))
    share, S = squared(f), np.diag(1 / scale**2)
    H = real_products(S, share, with_ends(Q, Q, w), s.imag, -2 * maps.power).assembled(ends)
    weighted = -share[:, None] * drive / scale**2
    g = ne.gradient(ne.turned(s), weighted, Q), ne.gradient_of_ends(ne.ends_of(s, w, ends), weighted)
    return ne.without_ends(H, np.concatenate(g), len(g[0]))


def _filter(omega: Array, Q: Complex) -> tuple[Complex, Array]:
    scale = np.sqrt((np.abs(Q) ** 2).mean(axis=0))
    power = (np.abs(Q / scale) ** 2).sum(axis=1)
    corner = np.sqrt((omega**2 * power).sum() / power.sum())
    s = 1j * omega
    return 1 / (s * s + FILTER_DAMPING * corner * s + corner**2), scale
