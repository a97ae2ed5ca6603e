"""plant, rule, N -> how well the energy of the undamped plant is kept (Bruschetta 3.3, (3.46))."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from sysid_bench.mechanics.integrators import RULES, one_step
from sysid_bench.mechanics.second_order import companion, input_matrix
from sysid_bench.nouns import Array, InputError, Plant, Sampling


@dataclass(frozen=True)
class Energy:
    """Free motion of the plant without its damping, from a random state, over N steps.

    midpoint and verlet are variational integrators (Marsden and West 2001); zoh is the exact flow.

    Returns swing (max |E_k / E_0 - 1|), drift (E_N / E_0 - 1), lagrangian (the largest relative mismatch of
    the discrete energy -dL_d/dh of the midpoint rule and the energy of the midpoint) and balance (largest
    mismatch of the energy's growth and the work h y'u of one forced step, relative to the largest energy; the
    output is the mean of two sampled velocities). Raises InputError on an unknown rule.
    """

    rule: str = "midpoint"

    def __post_init__(self) -> None:
        if self.rule not in RULES:
            raise InputError(f"analysis.rule must be one of {', '.join(RULES)}; got {self.rule!r}.")

    def compute(self, plant: Plant, sampling: Sampling, rng: np.random.Generator) -> dict[str, float]:
        h, M, K = sampling.h_s, plant.mass, plant.stiffness
        A, B = companion(M, np.zeros_like(M), K), input_matrix(M, np.eye(plant.n))
        Phi, Gamma = one_step(self.rule, A, B, h)
        P = block_diag(K, M)
        start = rng.standard_normal(2 * plant.n)
        free = run(Phi, Gamma, np.zeros((sampling.N, plant.n)), start)
        E = np.einsum("ki,ij,kj->k", free, P, free) / 2
        forced_u = rng.standard_normal((sampling.N, plant.n)) * np.abs(K).max()
        forced = run(Phi, Gamma, forced_u, start)
        return {
            "h_s": h,
            "swing": float(np.abs(E / E[0] - 1).max()),
            "drift": float(E[-1] / E[0] - 1),
            "lagrangian": lagrangian_mismatch(free[:200], M, K, h),
            "balance": balance_mismatch(forced, forced_u, P, h),
        }


def run(Phi: Array, Gamma: Array, u: Array, start: Array) -> Array:
    """x (N, 2n) of x_k+1 = Phi x_k + Gamma u_k."""
    x = np.empty((len(u), len(start)))
    x[0] = start
    force = u @ Gamma.T
    for k in range(len(u) - 1):
        x[k + 1] = Phi @ x[k] + force[k]
    return x


def balance_mismatch(x: Array, u: Array, P: Array, h: float) -> float:
    n = u.shape[1]
    E = np.einsum("ki,ij,kj->k", x, P, x) / 2
    mean_velocity = (x[1:, n:] + x[:-1, n:]) / 2
    work = h * np.sum(mean_velocity * u[:-1], axis=1)
    return float(np.abs(np.diff(E) - work).max() / E.max())


def lagrangian_mismatch(x: Array, M: Array, K: Array, h: float) -> float:
    """Largest |-dL_d/dh - E_mid| / E_mid along x, L_d of (2.19), by a central difference in h."""
    n = len(M)

    def Ld(q0: Array, q1: Array, step: float) -> float:
        v, q = (q1 - q0) / step, (q0 + q1) / 2
        return float(step * (v @ M @ v - q @ K @ q) / 2)

    mismatch = 0.0
    for q0, q1 in zip(x[:-1, :n], x[1:, :n]):
        v, q = (q1 - q0) / h, (q0 + q1) / 2
        E_mid = (v @ M @ v + q @ K @ q) / 2
        slope = (Ld(q0, q1, h * (1 + 1e-5)) - Ld(q0, q1, h * (1 - 1e-5))) / (2e-5 * h)
        mismatch = max(mismatch, abs(-slope - E_mid) / E_mid)
    return float(mismatch)
