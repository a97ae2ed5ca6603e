"""theta of M, D, K kept positive (semi)definite <-> the entries of their triangular factors."""

from __future__ import annotations

import numpy as np

from sysid_bench.mechanics.maximum import Parameters
from sysid_bench.mechanics.second_order import unpack
from sysid_bench.nouns import Array

FLOOR = 1e-6  # of the largest eigenvalue, for a start that is not definite


def definite_parameters(n: int) -> Parameters:
    """M = F F', D, K alike, F lower triangular: every phi is admissible, D may become singular."""
    q = n * (n + 1) // 2
    rows, cols = np.tril_indices(n)
    i, j = np.triu_indices(n)

    def factors(phi: Array) -> Array:
        F = np.zeros((3, n, n))
        F[:, rows, cols] = phi.reshape(3, q)
        return F

    def value(phi: Array) -> Array:
        F = factors(phi)
        return (F @ F.transpose(0, 2, 1))[:, i, j].ravel()

    def slope(phi: Array) -> Array:
        T = np.zeros((3, q, 3, q))
        for block, F in enumerate(factors(phi)):
            for k, (r, c) in enumerate(zip(rows, cols)):
                change = np.zeros((n, n))
                change[r] += F[:, c]
                T[block, :, block, k] = (change + change.T)[i, j]
        return T.reshape(3 * q, 3 * q)

    return Parameters(value, slope)


def factor(theta: Array, n: int) -> Array:
    """phi (ntheta,) of the definite matrices nearest to those of theta (ntheta,)."""
    rows, cols = np.tril_indices(n)
    parts = []
    for X in unpack(theta, n):
        values, vectors = np.linalg.eigh(X)
        floored = np.maximum(values, FLOOR * np.abs(values).max())
        parts.append(np.linalg.cholesky((vectors * floored) @ vectors.T)[rows, cols])
    return np.concatenate(parts)
