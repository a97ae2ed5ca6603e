"""sensitivities -> information matrix and gradient of (M, D, K), never forming the sensitivities.

A row of sensitivities is -s^b (g_i q_j + g_j q_i), g_i the i-th column of C G(s). Its products are Kronecker:
J^H W J = sum_f s^(b+b') (G^H W G) x (conj(q) q^T): five sums of outer products of two Hermitian n x n
matrices (mechanics.kronecker) give the whole block of n(n+1)3/2 parameters.

The ends of the record (free motion, what a filter makes of a cut) add the columns -s^c g_i w, w (F,) known: w is one
more entry of q, and the same sums give their products too.
"""

from __future__ import annotations

import numpy as np

from sysid_bench.mechanics.kronecker import products
from sysid_bench.mechanics.second_order import upper
from sysid_bench.mechanics.semidefinite import solved
from sysid_bench.nouns import Array, Complex

BLIND = 1e-13  # a combination of ends with less information, relative to its own, has none


def information(S: Complex, Omega: Complex, omega: Array) -> Array:
    """(3q, 3q) real sum over f of conj(s^b) s^b' S[i,k] Omega[j,l], symmetrised; s = j omega, both Hermitian."""
    return products(S, Omega, omega).assembled()


def turned(s: Complex) -> Complex:
    """(..., F, 3) conj(s^b) of M, D, K at s (..., F)."""
    back = np.conj(s)
    return np.stack([back * back, back, np.ones_like(s)], axis=-1)


def gradient(turns: Complex, back: Complex, q: Complex) -> Array:
    """(3q,) real inner product of the sensitivities with a residual; turns (..., F, 3) of `turned`, back (..., F, n)
    = (s^a C G)^H W R."""
    n = q.shape[-1]
    turned_back = (turns[..., None] * back[..., None, :]).reshape(-1, 3 * n)
    Z = np.real(np.conj(q).reshape(-1, n).T @ turned_back)
    i, j = upper(n)
    Z = Z.reshape(n, 3, n)
    return -np.where(i == j, Z[i, :, j].T, (Z[i, :, j] + Z[j, :, i]).T).ravel()


def ends_of(s: Complex, w: Array, ends: tuple[int, ...]) -> Complex:
    """(F, e) s^c w of each power c."""
    return (np.stack([s**c for c in ends]) * w).T


def gradient_of_ends(E: Complex, back: Complex) -> Array:
    """(n e,) the same for the columns of the ends, E (F, e) of `ends_of`."""
    return -np.real(np.conj(E).T @ back).ravel()


def gram_of_ends(E: Complex, S: Complex) -> Array:
    """(n e, n e) information of the columns of the ends alone."""
    (F, n, _), e = S.shape, E.shape[1]
    pairs = (np.conj(E)[:, :, None] * E[:, None, :]).reshape(F, e * e)
    A = np.real(pairs.T @ S.reshape(F, n * n)).reshape(e, e, n, n)
    return A.swapaxes(1, 2).reshape(e * n, e * n)


def without_ends(H: Array, g: Array, kept: int) -> tuple[Array, Array]:
    """H (kept, kept) and g (kept,) with all later unknowns eliminated: what cannot be told stays exactly blind."""
    right = np.column_stack([H[kept:, :kept], g[kept:]])
    half = solved(H[kept:, kept:], right, BLIND)
    across = H[:kept, kept:]
    return H[:kept, :kept] - across @ half[:, :-1], g[:kept] - across @ half[:, -1]
