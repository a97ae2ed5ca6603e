"""The midpoint (Cayley) discretisation and its inverse: of M, D, K, of state spaces, and of a subspace model."""

from __future__ import annotations

import numpy as np

from sysid_bench.mechanics.conversion import Modes
from sysid_bench.mechanics.projection import mass_from, read_back
from sysid_bench.nouns import Array, Diverged, Model, NotApplicable

Matrices = tuple[Array, Array, Array]
StateSpace = tuple[Array, Array, Array, Array]


def to_discrete(M: Array, D: Array, K: Array, h: float) -> Matrices:
    """M_d, D_d, K_d of M_d q(k) + D_d q(k-1) + K_d q(k-2) = f_d(k), Bruschetta (2011), (2.22); h in s."""
    inertia = M / h + h * K / 4
    return inertia + D / 2, -(2 * M / h - h * K / 2), inertia - D / 2


def to_continuous(Md: Array, Dd: Array, Kd: Array, h: float) -> Matrices:
    """M, D, K of the midpoint model, (2.26): the inverse of to_discrete, linear and symmetric."""
    return h / 4 * (Md + Kd - Dd), Md - Kd, (Md + Kd + Dd) / h


def discrete_force(u: Array, L: Array, h: float) -> Array:
    """f_d(k) (N-2, n) for k = 2 .. N-1: L h/4 [u(k) + 2 u(k-1) + u(k-2)], (2.24); u (N, nu)."""
    return h / 4 * (u[2:] + 2 * u[1:-1] + u[:-2]) @ L.T


def cayley(A: Array, B: Array, C: Array, D: Array, h: float) -> StateSpace:
    """Discrete state space of a continuous one by s = 2/h (z-1)/(z+1), (3.13)."""
    eye = np.eye(len(A))
    W = np.linalg.inv(eye - h / 2 * A)
    return W @ (eye + h / 2 * A), h * W @ B, C @ W, D + h / 2 * C @ W @ B


def inverse_cayley(Ad: Array, Bd: Array, Cd: Array, Dd: Array, h: float) -> StateSpace:
    """Continuous state space whose Cayley transform is (Ad, Bd, Cd, Dd); no pole of it may be at z = -1."""
    eye = np.eye(len(Ad))
    inverse = np.linalg.inv(Ad + eye)
    A = 2 / h * inverse @ (Ad - eye)
    W = eye - h / 2 * A
    return A, W @ Bd / h, Cd @ W, Dd - Cd @ W @ Bd / 2


def midpoint_start(form: Modes, model: Model, h: float, *, printed: bool = False) -> Matrices:
    """M, D, K through (4.15) from a discrete zero-order-hold modal form (p, c, b) of displacements.

    The printed J = B1 + B2 lacks 1/h: the gain of f_d is h, so J = (B1 + B2) / h. Raises NotApplicable without
    at least as many independent forces and displacement sensors as degrees of freedom, Diverged at a singular matrix.
    """
    n, (p, c, b) = model.n, form
    if model.output != "displacement" or len(p) != 2 * n:
        raise NotApplicable(
            f"the n4sid start (4.15) is for displacements and order {2 * n}; use start=nominal with a model that "
            "has values."
        )
    c = read_back(model, c)
    try:
        companion = np.real(np.linalg.solve(np.vstack([c, c * p]).T, (c * p**2).T).T)
        F21, F22 = companion[:, :n], companion[:, n:]
        B1, CAB = np.real(c @ b), np.real((c * p) @ b)
        J = (B1 + CAB - F22 @ B1) / (1 if printed else h)
        Md = mass_from(model, J)
    except np.linalg.LinAlgError:
        raise Diverged("the n4sid start (4.15) met a singular matrix.") from None
    Md, Dd, Kd = ((X + X.T) / 2 for X in (Md, -Md @ F22, -Md @ F21))
    return to_continuous(Md, Dd, Kd, h)
