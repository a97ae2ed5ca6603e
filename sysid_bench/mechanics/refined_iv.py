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
from sysid_bench.mechanics.hold_spectra import hold_spectrum
from sysid_bench.mechanics.in_band import Spectra, squared
from sysid_bench.mechanics.kronecker import products, with_ends
from sysid_bench.mechanics.response import Maps, modes_of, transfer
from sysid_bench.mechanics.second_order import unpack
from sysid_bench.mechanics.semidefinite import solved
from sysid_bench.nouns import Array, Complex, Diverged

FLOOR = (
    0.02  # of the largest eigenvalue: what the filter's matrices are kept above, or the first step overflows
)


def definite(X: Array, floor: float = FLOOR) -> Array:
    """The symmetric (n, n) matrix with eigenvalues not below `floor` of the largest magnitude."""
    values, vectors = np.linalg.eigh(X)
    return (vectors * np.maximum(values, floor * np.abs(values).max())) @ vectors.T


@dataclass(frozen=True, eq=False)
class _Filtered:
    """One pass: G (F, n, n) the inverse of the last estimate, Q (F, n) the motion seen, the force, w (F,) of the ends and
    their powers of s."""

    s: Complex
    G: Complex
    Q: Complex
    drive: Complex
    w: Array
    ends: tuple[int, ...]

    @cached_property
    def E(self) -> Complex:
        return ne.ends_of(self.s, self.w, self.ends)

    def seen(self, force: Complex) -> Complex:
        """(F, n) the last estimate's response to a force (F, n)."""
        return (self.G @ force[:, :, None])[:, :, 0]

    def weighed(self, X: Complex, W: Array) -> Complex:
        """(F, n) G^H W X."""
        return np.conj(((np.conj(X) * W)[:, None, :] @ self.G)[:, 0])

    def gram(self, W: Array) -> Complex:
        """(F, n, n) G^H W G."""
        G = self.G * np.sqrt(W)[:, None]
        return np.conj(G).swapaxes(1, 2) @ G


def _filtered(data: Spectra, maps: Maps, F: int, theta: Array) -> _Filtered:
    first, ends = 1 if maps.power else 0, tuple(range(2, -1 - maps.power, -1))
    s = 1j * data.omega[first:F]
    M, D, K = (definite(X) for X in unpack(theta, maps.n))
    modes = modes_of(M, D, K)
    G = transfer(modes, modes.shape, 1 / (s[:, None] - modes.poles))
    Q = (data.Y[first:F] @ np.linalg.pinv(maps.C).T) / (s**maps.power)[:, None]
    drive = (data.U[first:F] * hold_spectrum(s.imag, data.h, data.hold)[:, None]) @ maps.L.T
    return _Filtered(s, G, Q, drive, data.weight[first:F], ends)


def _model_motion(part: _Filtered, forced: Complex, S: Complex, W: Array) -> Complex:
    """Response of the last estimate to the input, with the boundary terms that fit the output best; S as of gram."""
    b = ne.gradient_of_ends(part.E, part.weighed(part.Q - forced, W))
    at_ends = -solved(ne.gram_of_ends(part.E, S), b, ne.BLIND).reshape(len(part.ends), -1)
    return forced + part.seen(part.E @ at_ends)


def _step(data: Spectra, maps: Maps, F: int, theta: Array) -> tuple[Array, Array]:
    """The next estimate and the weights that it was made with."""
    part = _filtered(data, maps, F, theta)
    forced, W = part.seen(part.drive), np.ones(maps.n)
    W = 1 / squared(part.Q - _model_motion(part, forced, part.gram(W), W)).mean(axis=0)
    S = part.gram(W)
    q = _model_motion(part, forced, S, W)
    lowest = -2 * maps.power
    H = products(S, with_ends(q, part.Q, part.w), part.s.imag, False, lowest).assembled(part.ends)
    back = part.weighed(forced, W)
    g = -ne.gradient(ne.turned(part.s), back, q)
    of_ends = -ne.gradient_of_ends(part.E, back)
    H, g = ne.without_ends(H, np.concatenate([g, of_ends]), len(g))
    d = np.sqrt(np.maximum(np.abs(np.diag(H)), 1e-300))
    return np.linalg.solve(H / np.outer(d, d), g / d) / d, W


def refine(
    data: Spectra, maps: Maps, F: int, theta: Array, steps: int, tolerance: float = 1e-6
) -> tuple[Array, int, bool]:
    """theta after at most `steps` steps, their number, and whether it came to rest (relative change).

    Needs an invertible output map. Raises Diverged where the equations cannot be solved.
    """
    for step in range(1, steps + 1):
        try:
            new, _ = _step(data, maps, F, theta)
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
