"""u, y -> the coefficients of A(q) y = B(q) u + e, by least squares or by instruments; and what they say of M, D, K."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.conversion import Modes, d2c, modes
from sysid_bench.nouns import Array, Diverged

SINGULAR = 1e13


@dataclass(frozen=True)
class Orders:
    """na autoregressive lags; nb input lags from lag nk on."""

    na: int
    nb: int
    nk: int

    @property
    def start(self) -> int:
        """First sample that has all its lags."""
        return max(self.na, self.nk + self.nb - 1)


@dataclass(frozen=True, eq=False)
class DifferenceEquation:
    """y(k) + sum_j a[j-1] y(k-j) = sum_j b[j] u(k-j): a (na, ny, ny), b (nk+nb, ny, nu), zero before nk."""

    a: Array
    b: Array

    @property
    def companion(self) -> Array:
        """(na ny, na ny) with the lags stacked, newest first; its eigenvalues are the poles."""
        na, ny = self.a.shape[:2]
        F = np.eye(na * ny, k=-ny)
        F[:ny] = -self.a.transpose(1, 0, 2).reshape(ny, na * ny)
        return F

    def named(self) -> dict[str, float]:
        """a1, b0, ... of a scalar equation; a1[0,0], ... of a matrix equation."""
        scalar = self.a.shape[1] == self.b.shape[2] == 1
        blocks = [(f"a{j + 1}", X) for j, X in enumerate(self.a)] + [
            (f"b{j}", X) for j, X in enumerate(self.b)
        ]
        if scalar:
            return {name: float(X[0, 0]) for name, X in blocks}
        return {f"{name}[{i},{j}]": float(X[i, j]) for name, X in blocks for i, j in np.ndindex(*X.shape)}


def regressors(u: Array, y: Array, orders: Orders) -> Array:
    """Phi (N - start, na ny + nb nu): minus the past outputs, then the inputs, newest first."""
    first, N = orders.start, len(y)
    past = [-y[first - j : N - j] for j in range(1, orders.na + 1)]
    inputs = [u[first - j : N - j] for j in range(orders.nk, orders.nk + orders.nb)]
    return np.hstack(past + inputs)


def from_theta(theta: Array, ny: int, nu: int, orders: Orders) -> DifferenceEquation:
    """theta (na ny + nb nu, ny), one column per output equation."""
    a = theta[: orders.na * ny].reshape(orders.na, ny, ny).transpose(0, 2, 1)
    b = np.zeros((orders.nk + orders.nb, ny, nu))
    b[orders.nk :] = theta[orders.na * ny :].reshape(orders.nb, nu, ny).transpose(0, 2, 1)
    return DifferenceEquation(a, b)


def least_squares(u: Array, y: Array, orders: Orders, parts: list[slice]) -> tuple[Array, Array, float]:
    """theta (p, ny) of the least equation error, what each part of the samples adds to it (J, p, ny), rms error.

    Of minimal norm where the regressors are dependent, as they are at a pole-zero cancellation.
    """
    Phi, target = regressors(u, y, orders), y[orders.start :]
    scale = np.maximum(np.sqrt((Phi**2).mean(axis=0)), np.finfo(float).tiny)
    Z = np.linalg.pinv(Phi / scale, rcond=1 / SINGULAR).T / scale
    theta = Z.T @ target
    error = target - Phi @ theta
    influences = np.array([Z[part].T @ error[part] for part in parts])
    return theta, influences, float(np.sqrt(np.mean(error**2)))


def modal_form(equation: DifferenceEquation, h: float, hold: str) -> Modes:
    """Continuous modal form of A(q)^-1 B(q) (na ny poles); raises Diverged where a pole has no logarithm."""
    ny = equation.a.shape[1]
    F = equation.companion
    entry = np.eye(len(F))[:, :ny]
    p, c, left = modes(F, entry, F[:ny])
    if not np.all(np.abs(p) > 0):
        raise Diverged("a discrete pole at zero has no continuous-time counterpart.")
    B = np.einsum("jyu,kj->kyu", equation.b, p[:, None] ** -np.arange(len(equation.b)))
    lam, b = d2c(p, np.einsum("ky,kyu->ku", left, B), h, hold)
    return lam, c, b
