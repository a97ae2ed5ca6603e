"""u, y, a first difference equation -> the one of refined instrumental variables, which output noise does not bias.

Young and Jakeman, Int. J. Control 29 (1979) 1-30; for matrix equations the error A(q) w is filtered by A(q)^-1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from sysid_bench.mechanics.conversion import separated_eig
from sysid_bench.mechanics.difference import SINGULAR, DifferenceEquation, Orders, from_theta, regressors
from sysid_bench.nouns import Array, Diverged

# The rounds end where no coefficient moves by more than this part of its standard error.
CONVERGED = 0.02


@dataclass(frozen=True, eq=False)
class InverseFilter:
    """A(q)^-1 = I + sum_k shapes_k rows_k / (q - p_k), unstable poles mirrored at the unit circle.

    T (kappa, ny, ny), T[kappa, o, i]: weight with which part kappa of a filtered signal in equation o reaches
    output i; the parts are the signal itself, then real and imaginary parts behind each pole of p (nm,). shapes (ny, nm).
    """

    p: np.ndarray
    shapes: np.ndarray
    T: Array

    def parts(self, X: Array) -> Array:
        """(N, kappa, columns) of X (N, columns)."""
        states = [lfilter([0.0, 1.0], [1.0, -p], X, axis=0) for p in self.p]
        return np.stack([X, *(part for z in states for part in (z.real, z.imag))], axis=1)

    def transients(self, N: int) -> Array:
        """(N, ny, na ny): outputs for each initial state of the filter."""
        powers = self.p[None, :] ** np.arange(N)[:, None]
        responses = powers[:, None, :] * self.shapes
        real = np.imag(self.p) == 0
        return np.concatenate([np.real(responses), np.imag(responses)[:, :, ~real]], axis=2)

    def output(self, V: Array) -> Array:
        """A(q)^-1 V for V (N, ny)."""
        return np.einsum("tko,koi->ti", self.parts(V), self.T)


def inverse_filter(equation: DifferenceEquation) -> InverseFilter:
    """1 / A(q) of the equation in partial fractions, poles outside the unit circle mirrored into it."""
    ny = equation.a.shape[1]
    p, V = separated_eig(equation.companion)
    p = np.where(np.abs(p) < 1, p, 1 / np.where(p == 0, 1, p).conj())
    shapes, rows = equation.companion[:ny] @ V, np.linalg.inv(V)[:, :ny]
    half = np.flatnonzero(np.imag(p) >= 0)
    weight = np.where(np.imag(p[half]) > 0, 2.0, 1.0)
    residues = weight[:, None, None] * rows[half][:, :, None] * shapes.T[half][:, None, :]
    T = [np.eye(ny), *(part for R in residues for part in (R.real, -R.imag))]
    return InverseFilter(p[half], shapes[:, half], np.array(T))


def delayed_inputs(equation: DifferenceEquation, u: Array) -> Array:
    """B(q) u (N, ny)."""
    N, nu = u.shape
    parts = (np.vstack([np.zeros((j, nu)), u[: N - j]]) @ b.T for j, b in enumerate(equation.b))
    return sum(parts, np.zeros(()))


def instruments(
    u: Array, y: Array, orders: Orders, start: DifferenceEquation, rounds: int, blocks: list[slice]
) -> tuple[Array, Array]:
    """theta (p, ny), and what each block of samples adds to it (J, p, ny).

    The instruments are the regressors of the simulated output: consistent for any noise that does not depend
    on the input, efficient for white noise on the output. Raises Diverged where they are singular.
    """
    equation, Phi, target = start, regressors(u, y, orders), y[orders.start :]
    theta = np.full((Phi.shape[1], y.shape[1]), np.inf)
    for _ in range(rounds):
        inverse, before = inverse_filter(equation), theta
        simulated = inverse.output(delayed_inputs(equation, u))
        problem = _Problem(inverse, inverse.parts(regressors(u, simulated, orders)), inverse.parts(Phi))
        theta = problem.solve(inverse.output(target))
        equation = from_theta(theta, y.shape[1], u.shape[1], orders)
        error = inverse.output(target - Phi @ theta)
        if np.all(np.abs(theta - before) <= CONVERGED * problem.standard_errors(error)):
            break
    return theta, problem.influences(error, blocks)


class _Problem:
    """(instruments)^T (regressors) theta = (instruments)^T target, all behind A(q)^-1.

    Psi, Phi (N, kappa, p): parts of the filtered instruments and regressors. The filter's own unknown initial
    state, responses E (N, ny, na ny), is projected out of the instruments.
    """

    def __init__(self, inverse: InverseFilter, Psi: Array, Phi: Array) -> None:
        self.T, self.Psi = inverse.T, Psi
        self.E = inverse.transients(len(Psi))
        flat = self.E.reshape(-1, self.E.shape[-1])
        self.through = np.linalg.pinv(flat.T @ flat) @ self._products(Phi, self.E).T
        self.initial = np.linalg.pinv(flat.T @ flat) @ self._products(Psi, self.E).T
        cross = self._cross(Phi) - self.initial.T @ (flat.T @ flat) @ self.through
        size = np.sqrt(np.maximum(np.abs(np.diag(cross)), np.finfo(float).tiny))
        if not np.linalg.cond(cross / np.outer(size, size)) < SINGULAR:
            raise Diverged("the instruments are singular: the record does not tell the coefficients apart.")
        self.inverse = np.linalg.inv(cross / np.outer(size, size)) / np.outer(size, size)

    def _products(self, X: Array, V: Array) -> Array:
        """(p ny, m): sum over samples and outputs of each filtered column of X times V (N, ny, m)."""
        N, kappa, p = X.shape
        inner = (X.reshape(N, -1).T @ V.reshape(N, -1)).reshape(kappa, p, *V.shape[1:])
        return np.einsum("krim,koi->rom", inner, self.T).reshape(-1, V.shape[2])

    def _cross(self, Phi: Array) -> Array:
        N, kappa, p = Phi.shape
        gram = (self.Psi.reshape(N, -1).T @ Phi.reshape(N, -1)).reshape(kappa, p, kappa, p)
        weights = np.einsum("koi,lmi->kolm", self.T, self.T)
        return np.einsum("krls,kolm->rosm", gram, weights, optimize=True).reshape(2 * [p * self.T.shape[1]])

    def _score(self, V: Array, part: slice = slice(None)) -> Array:
        products = self._products(self.Psi[part], V[part, :, None])[:, 0]
        return products - self.initial.T @ np.einsum("tim,ti->m", self.E[part], V[part])

    def solve(self, target: Array) -> Array:
        return (self.inverse @ self._score(target)).reshape(-1, self.T.shape[1])

    def standard_errors(self, error: Array) -> Array:
        """(p, ny), roughly: as if the filtered error were white and alike in all outputs."""
        return np.sqrt(np.abs(np.diag(self.inverse)) * np.mean(error**2)).reshape(-1, self.T.shape[1])

    def influences(self, error: Array, blocks: list[slice]) -> Array:
        flat = self.E.reshape(-1, self.E.shape[-1])
        initial = np.linalg.lstsq(flat, error.ravel(), rcond=None)[0]
        error = error - (self.E @ initial)
        scores = [self._score(error, part) for part in blocks]
        return np.array([(self.inverse @ s).reshape(-1, self.T.shape[1]) for s in scores])
