"""spectra -> M, D, K by one linear least squares in the band: the start that needs no guess.

Equation error P(s) Y - L U - polynomial(s), low-pass filtered by second-order poles at the output's rms frequency.
"""

from __future__ import annotations

import numpy as np

from sysid_bench.mechanics import normal_equations as ne
from sysid_bench.mechanics.equation import Equation
from sysid_bench.mechanics.in_band import squared
from sysid_bench.mechanics.kronecker import real_products, with_ends
from sysid_bench.nouns import Array, Complex

FILTER_DAMPING = 1.4


def equation_error_normal(equation: Equation) -> tuple[Array, Array]:
    """H (3q, 3q), g (3q,) of the equation-error least squares, without the polynomial of the record's ends."""
    f, scale = _filter(equation.omega, equation.Q)
    share, S = squared(f), np.diag(1 / scale**2)
    Omega = with_ends(equation.Q, equation.Q, equation.w)
    H = real_products(S, share, Omega, equation.omega, min(equation.ends) * 2).assembled(equation.ends)
    weighted = -share[:, None] * equation.force / scale**2
    g = ne.gradient(equation.turns, weighted, equation.Q), ne.gradient_of_ends(equation.E, weighted)
    return ne.without_ends(H, np.concatenate(g), len(g[0]))


def _filter(omega: Array, Q: Complex) -> tuple[Complex, Array]:
    scale = np.sqrt((np.abs(Q) ** 2).mean(axis=0))
    power = (np.abs(Q / scale) ** 2).sum(axis=1)
    corner = np.sqrt((omega**2 * power).sum() / power.sum())
    s = 1j * omega
    return 1 / (s * s + FILTER_DAMPING * corner * s + corner**2), scale
