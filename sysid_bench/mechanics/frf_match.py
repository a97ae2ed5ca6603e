"""a frequency response -> symmetric M, D, K whose inverse dynamic stiffness it is: linear, no matrix logarithm."""

from __future__ import annotations

import numpy as np

from sysid_bench.mechanics import normal_equations as ne
from sysid_bench.mechanics.second_order import unpack
from sysid_bench.nouns import Array, Complex, Diverged


def match(omega: Array, G: Complex) -> tuple[Array, Array, Array]:
    """M, D, K minimising sum ||G (K - w^2 M + j w D) G - G||_F^2 over G (F, n, n) at omega (F,) rad/s.

    The weight G on both sides makes it the output error of the match, to first order. Raises Diverged where
    the response has no information.
    """
    n = G.shape[1]
    S = np.conj(np.swapaxes(G, 1, 2)) @ G
    Omega = np.conj(G) @ np.swapaxes(
        G, 1, 2
    )  # sum over inputs of conj(g_j) g_l, g a row of G: symmetric plants
    H = ne.information(S, Omega, omega)
    back = np.swapaxes(np.conj(G), 1, 2) @ G
    turns = ne.turned(1j * omega)
    g = -sum(ne.gradient(turns, back[:, :, k], G[:, :, k]) for k in range(n))
    d = np.sqrt(np.diag(H))
    try:
        theta = np.linalg.solve(H / np.outer(d, d), g / d) / d
    except np.linalg.LinAlgError:
        raise Diverged("the frequency response does not determine mass, damping and stiffness.") from None
    return unpack(theta, n)
