"""what is left -> where it can come from: the share that some force at each place would explain, and that force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid_bench.gap.basis import Basis
from sysid_bench.gap.columns import own_columns, theta_columns
from sysid_bench.gap.motion import Seen as SeenMotion
from sysid_bench.gap.motion import free_response
from sysid_bench.gap.place_rows import place_rows
from sysid_bench.gap.problem import Point, Problem
from sysid_bench.mechanics.effect import direction
from sysid_bench.nouns import Array, Complex

MOST = 36  # places refitted for: those of eight degrees of freedom


def places(n: int) -> list:
    """Every DOF and every pair of DOFs."""
    return [*range(n), *((i, j) for i in range(n) for j in range(i + 1, n))]


def explained_by_place(
    problem: Problem, point: Point, seens: list[SeenMotion], b: Basis, prior_scale: float
) -> dict:
    """Share of what is left that some force history at one place could explain, M, D, K refitted, for every place.

    A force along c moves the channels along g = G c at each frequency; what lies across g cannot come from there. Of very
    many places only the likeliest MOST are refitted for.
    """
    traces, n = _equations(problem, point, seens, b), problem.model.n
    prior = problem.prior * prior_scale
    plain, x = _leftover(traces, None, b, prior)
    left = [one.r - one.Z @ x[one.where] for one in traces]
    out = {place: _along(traces, direction(place, n), left) / max(plain, 1e-300) for place in places(n)}
    for place in sorted(out, key=lambda place: -out[place])[:MOST]:
        out[place] = 1 - _leftover(traces, direction(place, n), b, prior)[0] / max(plain, 1e-300)
    return out


@dataclass(frozen=True, eq=False)
class _Equations:
    """One trace's: Z (F, ny, p) whitened columns, r (F, ny) target, G (F, ny, n) response, where (p,) in the basis the
    columns stand; gram (p, p) and right (p,) over all channels."""

    Z: Complex
    r: Complex
    G: Complex
    where: NDArray[np.int_]
    gram: Array
    right: Array

    def across(self, c: Array) -> Complex:
        """(F, ny) unit vectors along which a force at c moves the channels."""
        g = self.G @ c
        return g / np.maximum(np.linalg.norm(g, axis=1), 1e-300)[:, None]


def _equations(problem: Problem, point: Point, seens: list[SeenMotion], b: Basis) -> list[_Equations]:
    out, at = [], 0
    for s in seens:
        free = free_response(s.linear.assembly, s.trace, problem.model.output)
        own = np.concatenate([theta_columns(problem, s), own_columns(problem, point, s)], axis=2)
        w = s.trace.weight[:, :, None]
        where = np.concatenate([np.arange(at, at + free.shape[2]), np.arange(b.offset, len(b.norms))])
        Z, at = np.concatenate([free, own], axis=2) * (w / b.norms[where]), at + free.shape[2]
        r, flat = s.left * s.trace.weight, _stacked(Z.reshape(-1, Z.shape[2]))
        right = flat.T @ _stacked(r.reshape(-1))
        out.append(_Equations(Z, r, s.G[:, :, : problem.model.n] * w, where, flat.T @ flat, right))
    return out


def _stacked(X: Complex) -> Array:
    return np.concatenate([X.real, X.imag])


def _along(traces: list[_Equations], c: Array, left: list[Complex]) -> float:
    """Energy along G c of residuals (F, ny)."""
    hits = [np.sum(one.across(c).conj() * left_one, axis=1) for one, left_one in zip(traces, left)]
    return sum(float(np.sum(np.abs(hit) ** 2)) for hit in hits)


def _leftover(traces: list[_Equations], c: Array | None, b: Basis, prior: Array) -> tuple[float, Array]:
    """Energy across G c that M, D, K and the free response cannot explain, all of it where c is None; what they are then."""
    size, offset = len(b.norms), b.offset
    gram, right, energy, rows = np.zeros((size, size)), np.zeros(size), 0.0, 0
    for one in traces:
        part, match = one.gram, one.right
        energy += float(np.sum(np.abs(one.r) ** 2))
        rows += one.r.size * 2
        if c is not None:
            g = one.across(c)[:, None, :].conj()
            along, hit = _stacked((g @ one.Z)[:, 0]), _stacked((g @ one.r[:, :, None])[:, 0, 0])
            part, match = part - along.T @ along, match - along.T @ hit
            energy -= float(hit @ hit)
            rows -= len(hit)
        gram[np.ix_(one.where, one.where)] += part
        right[one.where] += match
    nt, left = len(prior), energy
    held, x = np.zeros(size), np.zeros(size)
    for _ in range(2):
        pull = max(1.0, left / max(rows, 1)) / prior**2
        held[offset : offset + nt] = pull / b.norms[offset : offset + nt] ** 2
        toward = np.zeros(size)
        toward[offset : offset + nt] = -pull * b.theta0 / b.norms[offset : offset + nt]
        x = np.linalg.solve(gram + np.diag(held + 1e-9), right + toward)
        left = max(float(energy - 2 * right @ x + x @ gram @ x), 0.0)
    return left, x


def unexplained_force(problem: Problem, s: SeenMotion, left: np.ndarray) -> tuple[Array, Array]:
    """(N, n) adjoint force and (N, ny) residual of one trace, from the whitened spectrum that is left."""
    R = left * s.trace.weight
    return s.trace.signal(np.einsum("fci,fc->fi", s.G[:, :, : problem.model.n].conj(), R)), s.trace.signal(R)


def promise_of(problem: Problem, seens, b: Basis, place) -> float:
    """Energy that a handful of general shapes explains together at a place: whether it is worth the whole catalogue."""
    c = direction(place, problem.model.n)
    spectra = []
    for s in seens:
        x, v = s.q @ c, s.v @ c
        z, w = x / max(x.std(), 1e-300), v / max(v.std(), 1e-300)
        shapes = [
            np.sign(w),
            np.abs(w) * w,
            z**3,
            z * z,
            np.clip(z, -0.5, 0.5),
            np.ones_like(z),
            _follower(z),
        ]
        spectra.append([s.trace.spectrum(np.column_stack(shapes)).T])
    A = place_rows(seens, c, spectra, b.ridge)
    A /= np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    QA, target = b.Q.T @ A, A.T @ b.r
    return float(target @ np.linalg.solve(A.T @ A - QA.T @ QA + 1e-6 * np.eye(len(target)), target))


def _follower(z: Array) -> Array:
    """How far a place has moved since it last turned, up to a limit: what hysteresis and play depend on."""
    turned = np.concatenate([[True], np.diff(np.sign(np.diff(z, prepend=z[0]))) != 0])
    last = np.maximum.accumulate(np.where(turned, np.arange(len(z)), 0))
    return np.clip(z - z[last], -0.6, 0.6)
