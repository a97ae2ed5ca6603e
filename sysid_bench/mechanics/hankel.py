"""samples -> one small triangular factor of their block Hankel matrix; all that N samples cost a subspace method."""

from __future__ import annotations

import numpy as np

from sysid_bench.nouns import Array

# Pivots of the Gram matrix's factor below this have lost half of their digits: then the QR of the data is taken.
SAFE_PIVOT = 1e-5


def hankel_gram(z: Array, s: int) -> Array:
    """H H^T (s r, s r) of the block Hankel matrix H with s block rows of z (N, r), in O(N r^2 s).

    Along a block diagonal one product leaves and one enters: G[k+1, l+1] = G[k, l] - z_k z_l^T + z_k+J z_l+J^T.
    """
    N, r = z.shape
    J = N - s + 1
    first, last = z[: s - 1].ravel(), z[J : J + s - 1].ravel()
    change = np.outer(last, last) - np.outer(first, first)
    G = np.empty((s * r, s * r))
    for lag in range(s):
        G[:r, lag * r : (lag + 1) * r] = z[:J].T @ z[lag : lag + J]
    for k in range((s - 1) * r):
        # scalar row k + r, from row k one block up and one block left
        G[k + r, r:] = G[k, : (s - 1) * r] + change[k]
    return np.triu(G) + np.triu(G, 1).T


def hankel(z: Array, s: int) -> Array:
    """(s r, N - s + 1): the block Hankel matrix itself."""
    J = len(z) - s + 1
    return np.concatenate([z[k : k + J].T for k in range(s)])


def order_rows(nu: int, ny: int, i: int) -> Array:
    """(2 i (nu + ny),) rows of the 2 i blocks of [u y] in the order future inputs, past inputs, past outputs, future outputs."""
    rows = np.arange(2 * i * (nu + ny)).reshape(2 * i, nu + ny)
    parts = (rows[i:, :nu], rows[:i, :nu], rows[:i, nu:], rows[i:, nu:])
    return np.concatenate([part.ravel() for part in parts])


def triangular_factor(z: Array, order: Array, s: int, gram: Array | None = None) -> Array:
    """Lower triangular R (s r, s r) with R R^T = H H^T, rows of H in `order`.

    Cholesky of the Gram matrix; the QR of the data (slower, exact) where that would lose digits, as it does
    for outputs without noise.
    """
    gram = hankel_gram(z, s) if gram is None else gram
    R = safe_cholesky(gram[np.ix_(order, order)])
    if R is None:
        R = np.transpose(np.linalg.qr(hankel(z, s)[order].T, mode="r"))
    return R


def safe_cholesky(G: Array) -> Array | None:
    """Cholesky factor (k, k), or None where a pivot is so small against its row that half of the digits are lost."""
    try:
        R = np.linalg.cholesky(G)
    except np.linalg.LinAlgError:
        return None
    return R if np.all(np.diag(R) ** 2 > SAFE_PIVOT**2 * np.diag(G)) else None
