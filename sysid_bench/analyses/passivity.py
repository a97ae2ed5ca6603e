"""plant, rule, sampled output -> is the discretised plant passive? (Bruschetta 3.3, the LMI (3.45)).

Either answer comes with its certificate. Kept: the storage function x' P x / 2 with P = diag(K, M) / h solves
the discrete LMI. Lost: a frequency at which G + G^H has a negative eigenvalue on the unit circle; by the
discrete positive-real lemma no P can then solve the LMI.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from sysid_bench.mechanics.integrators import one_step
from sysid_bench.mechanics.second_order import companion, input_matrix
from sysid_bench.nouns import Array, InputError, Plant, Sampling

MARGIN_ROUNDING, LMI_ROUNDING = 1e-9, 1e-12


@dataclass(frozen=True)
class Passivity:
    """Passivity of the map from the force to a sampled velocity, one force and one sensor per DOF.

    rule    midpoint (Cayley, 3.13) | zoh
    output  sampled: v_k; averaged: (v_k + v_k+1) / 2; increment: (q_k+1 - q_k) / h
    angles  points on the upper unit circle

    Returns margin (smallest eigenvalue of G + G^H over the angles, relative to its largest entry), worst_angle
    in rad, lmi (largest eigenvalue of (3.45) at P, relative), lmi_printed (the same with P = diag(K, M), the
    unscaled energy of Theorem 3.3.1) and passive (1, 0, NaN: undecided). Raises InputError on unknown words.
    """

    rule: str = "midpoint"
    output: str = "averaged"
    angles: int = 2000

    def __post_init__(self) -> None:
        for name, value, known in (
            ("rule", self.rule, ("midpoint", "zoh")),
            ("output", self.output, ("sampled", "averaged", "increment")),
        ):
            if value not in known:
                raise InputError(f"analysis.{name} must be one of {', '.join(known)}; got {value!r}.")

    def compute(self, plant: Plant, sampling: Sampling, rng: np.random.Generator) -> dict[str, float]:
        h = sampling.h_s
        A = companion(plant.mass, plant.damping, plant.stiffness)
        Ad, Bd = one_step(self.rule, A, input_matrix(plant.mass, np.eye(plant.n)), h)
        Cd, Dd = sampled_output(self.output, Ad, Bd, h)
        margin, worst = unit_circle_margin(Ad, Bd, Cd, Dd, self.angles)
        P = block_diag(plant.stiffness, plant.mass)
        lmi = lmi_eigenvalue(Ad, Bd, Cd, Dd, P / h)
        passive = 0.0 if margin < -MARGIN_ROUNDING else 1.0 if lmi < LMI_ROUNDING else np.nan
        return {
            "h_s": h,
            "margin": margin,
            "worst_angle": worst,
            "lmi": lmi,
            "lmi_printed": lmi_eigenvalue(Ad, Bd, Cd, Dd, P),
            "passive": passive,
        }


def sampled_output(output: str, Ad: Array, Bd: Array, h: float) -> tuple[Array, Array]:
    """Cd (n, 2n), Dd (n, n) of the velocity as it is sampled."""
    n = len(Ad) // 2
    q, v = np.eye(n, 2 * n), np.eye(n, 2 * n, n)
    if output == "sampled":
        return v, np.zeros((n, n))
    if output == "averaged":  # for the midpoint rule this is C_1/2, D_1/2 of (3.13)
        return v @ (np.eye(2 * n) + Ad) / 2, v @ Bd / 2
    return q @ (Ad - np.eye(2 * n)) / h, q @ Bd / h


def unit_circle_margin(Ad: Array, Bd: Array, Cd: Array, Dd: Array, angles: int) -> tuple[float, float]:
    """Smallest eigenvalue of G + G^H on the unit circle, relative to max |G|, and its angle in rad."""
    theta = (np.arange(angles) + 0.5) * np.pi / angles
    z = np.exp(1j * theta)
    G = Cd @ np.linalg.solve(z[:, None, None] * np.eye(len(Ad)) - Ad, Bd[None]) + Dd
    smallest = np.linalg.eigvalsh(G + np.conj(np.swapaxes(G, 1, 2)))[:, 0]
    worst = int(np.argmin(smallest))
    return float(smallest[worst] / np.abs(G).max()), float(theta[worst])


def lmi_eigenvalue(Ad: Array, Bd: Array, Cd: Array, Dd: Array, P: Array) -> float:
    """Largest eigenvalue of the matrix of (3.45), relative to its largest entry's size before cancellation."""
    cross = Ad.T @ P @ Bd - Cd.T
    matrix = np.block([[Ad.T @ P @ Ad - P, cross], [cross.T, Bd.T @ P @ Bd - (Dd + Dd.T)]])
    scale = max(np.abs(P).max(), np.abs(Cd).max(), np.abs(Dd).max())
    return float(np.linalg.eigvalsh(matrix)[-1] / scale)
