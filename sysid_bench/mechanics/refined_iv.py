"""spectra, a start -> M, D, K by refined instrumental variables: linear steps only, no cost to descend.

Each step filters both sides of M q'' + D q' + K q = L u by the inverse of the last estimate and solves the
linear equations with the model's own response as instruments (the matrix form of SRIVC: Young & Jakeman 1980;
Gonzalez, Rojas, Welsh & Rojas 2023). Noise on y does not bias it, since instruments come from u alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid_bench.mechanics import normal_equations as ne
from sysid_bench.mechanics.equation import Equation
from sysid_bench.mechanics.in_band import squared
from sysid_bench.mechanics.kronecker import grams, products, with_ends
from sysid_bench.mechanics.response import Modes, modes_of, transfer
from sysid_bench.mechanics.second_order import unpack
from sysid_bench.mechanics.semidefinite import solved
from sysid_bench.nouns import Array, Complex, Diverged

FLOOR = (
    0.02  # of the largest eigenvalue: what the filter's matrices are kept above, or the first step overflows
)


def definite(X: Array, floor: float = FLOOR) -> Array:
    """The symmetric (..., n, n) matrices with eigenvalues not below `floor` of each one's largest magnitude."""
    values, vectors = np.linalg.eigh(X)
    lifted = np.maximum(values, floor * np.abs(values).max(axis=-1, keepdims=True))
    return (vectors * lifted[..., None, :]) @ vectors.swapaxes(-1, -2)


@dataclass(frozen=True, eq=False)
class _Filter:
    """The last estimate's response in the band of an equation, by its modes: G = shape diag(resolvent) left."""

    equation: Equation
    modes: Modes
    resolvent: Complex

    @cached_property
    def G(self) -> Complex:
        """(F, n, n)"""
        return transfer(self.modes, self.modes.shape, self.resolvent)

    def seen(self, force: Complex) -> Complex:
        """(F, n) the response to a force (F, n)."""
        return (force @ self.modes.left.T * self.resolvent) @ self.modes.shape.T

    def weighed(self, X: Complex, W: Array) -> Complex:
        """(F, n) G^H W X."""
        return np.conj((np.conj(X) * W @ self.modes.shape * self.resolvent) @ self.modes.left)

    def gram(self, W: Array) -> Complex:
        """(F, n, n) G^H W G."""
        return grams(self.G * np.sqrt(W)[:, None])

    def motion(self, forced: Complex, S: Complex, W: Array) -> Complex:
        """(F, n) forced, with the boundary terms that fit the motion seen best; S as of gram."""
        E, ends = self.equation.E, len(self.equation.ends)
        b = ne.gradient_of_ends(E, self.weighed(self.equation.Q - forced, W))
        at_ends = -solved(ne.gram_of_ends(E, S), b, ne.BLIND).reshape(ends, -1)
        return forced + self.seen(E @ at_ends)


def _filter(equation: Equation, theta: Array) -> _Filter:
    modes = modes_of(*definite(np.stack(unpack(theta, equation.n))))
    return _Filter(equation, modes, 1 / (equation.s[:, None] - modes.poles))


def _step(equation: Equation, theta: Array) -> Array:
    """The next estimate."""
    filtered, Q = _filter(equation, theta), equation.Q
    forced, W = filtered.seen(equation.force), np.ones(equation.n)
    W = 1 / squared(Q - filtered.motion(forced, filtered.gram(W), W)).mean(axis=0)
    S = filtered.gram(W)
    q = filtered.motion(forced, S, W)
    H = products(S, with_ends(q, Q, equation.w), equation.omega, False, 2 * min(equation.ends)).assembled(
        equation.ends
    )
    back = filtered.weighed(forced, W)
    g = -ne.gradient(equation.turns, back, q)
    of_ends = -ne.gradient_of_ends(equation.E, back)
    H, g = ne.without_ends(H, np.concatenate([g, of_ends]), len(g))
    d = np.sqrt(np.maximum(np.abs(np.diag(H)), 1e-300))
    return np.linalg.solve(H / np.outer(d, d), g / d) / d


def refine(equation: Equation, theta: Array, steps: int, tolerance: float = 1e-6) -> tuple[Array, int, bool]:
    """theta after at most `steps` steps, their number, and whether it came to rest (relative change).

    Needs an invertible output map. Raises Diverged where the equations cannot be solved.
    """
    for step in range(1, steps + 1):
        try:
            new = _step(equation, theta)
        except np.linalg.LinAlgError as problem:
            raise Diverged(
                f"refined instrumental variables: step {step} has no solution ({problem})."
            ) from None
        change = max(
            np.linalg.norm(a - b) / np.linalg.norm(a)
            for a, b in zip(new.reshape(3, -1), theta.reshape(3, -1))
        )
        theta = new
        if not np.all(np.isfinite(theta)):
            raise Diverged(f"refined instrumental variables: step {step} is not finite.")
        if change < tolerance:
            return theta, step, True
    return theta, steps, False
