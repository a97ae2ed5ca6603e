"""theta of M, D, K with D = alpha M + beta K <-> (vech M, vech K, alpha, beta)."""

from __future__ import annotations

import numpy as np

from sysid_bench.mechanics.identifiability import entry_names
from sysid_bench.mechanics.maximum import Parameters
from sysid_bench.nouns import Array


def proportional_names(n: int) -> list[str]:
    """Names of phi (n (n + 1) + 2,)."""
    return [name for name in entry_names(n) if name[0] != "D"] + ["alpha", "beta"]


def proportional_parameters(n: int) -> Parameters:
    """theta and its derivative as functions of phi (n (n + 1) + 2,)."""
    q = n * (n + 1) // 2

    def value(phi: Array) -> Array:
        M, K, (alpha, beta) = phi[:q], phi[q : 2 * q], phi[2 * q :]
        return np.concatenate([M, alpha * M + beta * K, K])

    def slope(phi: Array) -> Array:
        M, K, (alpha, beta) = phi[:q], phi[q : 2 * q], phi[2 * q :]
        one, zero, none = np.eye(q), np.zeros((q, q)), np.zeros((q, 2))
        of_damping = [alpha * one, beta * one, np.column_stack([M, K])]
        return np.block([[one, zero, none], of_damping, [zero, one, none]])

    return Parameters(value, slope)


def proportions(theta: Array, n: int) -> Array:
    """phi of the proportional damping nearest to that of theta (ntheta,)."""
    M, D, K = theta.reshape(3, -1)
    factors = np.linalg.lstsq(np.column_stack([M, K]), D, rcond=None)[0]
    return np.concatenate([M, K, factors])
