"""continuous modal form -> M, D, K: the modal projection of De Angelis and Lus, and the direct one.

A modal form is (lam, c, b): y = sum_k c_k b_k / (s - lam_k) u with all 2n poles (conjugates included).
"""

from __future__ import annotations

import numpy as np

from sysid_bench.mechanics.conversion import Modes
from sysid_bench.nouns import Array, Diverged, Model, NotApplicable

INTEGRATIONS = {"displacement": 0, "velocity": 1, "acceleration": 2}
PROJECTIONS = ("direct", "modal")

Matrices = tuple[Array, Array, Array]


def project(form: Modes, model: Model, projection: str) -> Matrices:
    """M, D, K (n, n) symmetric from a continuous modal form with 2n poles; the model says only L, C and the output.

    direct: M = (C A B)^-1, [K D] from C A^2 [C; C A]^-1, symmetrised; wants at least as many independent forces as DOFs.
    modal: complex mode shapes scaled from the residues, M = (Phi Lam Phi^T)^-1, K = -(Phi Lam^-1 Phi^T)^-1,
    D = -M Phi Lam^2 Phi^T M (De Angelis, Lus, Betti, Longman, J. Appl. Mech. 69, 2002); wants one force at least.
    Both want at least as many independent sensors as DOFs. Raises NotApplicable, or Diverged where a matrix is singular.
    """
    lam, c, b = form
    n = model.n
    if len(lam) != 2 * n:
        raise NotApplicable(
            f"M, D, K of {n} degrees of freedom need order {2 * n}; the model has {len(lam)}."
        )
    shapes = read_back(model, c) / lam ** INTEGRATIONS[model.output]
    try:
        found = _direct(lam, shapes, b, model) if projection == "direct" else _modal(lam, shapes, b, model)
    except np.linalg.LinAlgError:
        raise Diverged(f"the {projection} projection met a singular matrix.") from None
    if not all(np.all(np.isfinite(X)) for X in found):
        raise Diverged(f"the {projection} projection met a singular matrix.")
    return found


def read_back(model: Model, c: np.ndarray) -> np.ndarray:
    """Shapes at the degrees of freedom (n, k) from shapes at the sensors c (ny, k); least squares for ny > n.

    Raises NotApplicable for fewer independent sensors than n.
    """
    if np.linalg.matrix_rank(model.output_map) < model.n:
        raise NotApplicable(
            f"M, D, K need {model.n} independent sensors; output_map has rank {np.linalg.matrix_rank(model.output_map)}."
        )
    return np.linalg.pinv(model.output_map) @ c


def mass_from(model: Model, inertance: Array) -> Array:
    """M (n, n) from M^-1 L (n, nu), not yet symmetric; least squares for nu > n.

    Raises NotApplicable for fewer independent forces than n.
    """
    if np.linalg.matrix_rank(model.input_map) < model.n:
        raise NotApplicable(
            f"this needs {model.n} independent forces; input_map has rank {np.linalg.matrix_rank(model.input_map)} "
            "(n4sid with projection=modal takes fewer)."
        )
    return np.linalg.inv(inertance @ np.linalg.pinv(model.input_map))


def _symmetric(X: np.ndarray) -> Array:
    return np.real(X + X.T) / 2


def _direct(lam: np.ndarray, shapes: np.ndarray, b: np.ndarray, model: Model) -> Matrices:
    n = model.n
    M = mass_from(model, np.real((shapes * lam) @ b))  # C A B = M^-1 L
    observability = np.vstack([shapes, shapes * lam])
    KD = -M @ np.linalg.solve(observability.T, (shapes * lam**2).T).T
    return _symmetric(M), _symmetric(KD[:, n:]), _symmetric(KD[:, :n])


def _modal(lam: np.ndarray, shapes: np.ndarray, b: np.ndarray, model: Model) -> Matrices:
    """b_k = phi_k^T L / s_k with shapes_k = s_k phi_k: s_k^2 by least squares over the forces."""
    driven = shapes.T @ model.input_map
    scale2 = (b.conj() * driven).sum(axis=1) / (np.abs(b) ** 2).sum(axis=1)
    phi = shapes / np.sqrt(scale2)
    M = np.linalg.inv((phi * lam) @ phi.T)
    K = -np.linalg.inv((phi / lam) @ phi.T)
    D = -M @ ((phi * lam**2) @ phi.T) @ M
    return _symmetric(M), _symmetric(D), _symmetric(K)
