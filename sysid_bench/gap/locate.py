"""what is left -> where it can come from: the share that some force at each place would explain, and that force."""

from __future__ import annotations

import numpy as np

from sysid_bench.gap.basis import Basis
from sysid_bench.gap.columns import own_columns, theta_columns
from sysid_bench.gap.motion import Seen as SeenMotion
from sysid_bench.gap.motion import free_response
from sysid_bench.gap.place_rows import place_rows
from sysid_bench.gap.problem import Point, Problem
from sysid_bench.mechanics.effect import direction
from sysid_bench.nouns import Array


def places(n: int) -> list:
    """Every DOF and every pair of DOFs."""
    return [*range(n), *((i, j) for i in range(n) for j in range(i + 1, n))]


def explained_by_place(
    problem: Problem, point: Point, seens: list[SeenMotion], b: Basis, prior_scale: float
) -> dict:
    """Share of what is left that some force history at one place could explain, M, D, K refitted, for every place.

    A force along c moves the channels along g = G c at each frequency; what lies across g cannot come from there.
    """
    traces = [_whitened(problem, point, s) for s in seens]
    offset = b.offset
    plain = _leftover(traces, None, b, problem.prior * prior_scale, offset)
    out = {}
    for place in places(problem.model.n):
        c = direction(place, problem.model.n)
        out[place] = 1 - _leftover(traces, c, b, problem.prior * prior_scale, offset) / max(plain, 1e-300)
    return out


def _whitened(problem: Problem, point: Point, s: SeenMotion):
    """(Z, r, G): complex whitened columns (F, ny, p), target (F, ny), response (F, ny, n) of one trace."""
    free = free_response(s.linear.assembly, s.trace, problem.model.output)
    own = np.concatenate([theta_columns(problem, s), own_columns(problem, point, s)], axis=2)
    w = s.trace.weight[:, :, None]
    return free * w, own * w, s.left * s.trace.weight, s.G[:, :, : problem.model.n] * w


def _leftover(traces, c: Array | None, b: Basis, prior: Array, offset: int) -> float:
    """Energy across G c that M, D, K and the free response cannot explain; all of it where c is None."""
    size = len(b.norms)
    gram, right, energy, rows, at = np.zeros((size, size)), np.zeros(size), 0.0, 0, 0
    for free, own, r, G in traces:
        Z = np.concatenate([free, own], axis=2)
        where = np.concatenate([np.arange(at, at + free.shape[2]), np.arange(offset, size)])
        Z, at = Z / b.norms[where], at + free.shape[2]
        flat, target = Z.reshape(-1, Z.shape[2]), r.reshape(-1)
        part = (flat.conj().T @ flat).real
        match = (flat.conj().T @ target).real
        energy += float(np.sum(np.abs(r) ** 2))
        rows += r.size * 2
        if c is not None:
            g = G @ c
            g = g / np.maximum(np.linalg.norm(g, axis=1), 1e-300)[:, None]
            along = np.einsum("fc,fcp->fp", g.conj(), Z, optimize=True)
            hit = np.einsum("fc,fc->f", g.conj(), r)
            part -= (along.conj().T @ along).real
            match -= (along.conj().T @ hit).real
            energy -= float(np.sum(np.abs(hit) ** 2))
            rows -= 2 * len(hit)
        gram[np.ix_(where, where)] += part
        right[where] += match
    nt, left = len(prior), energy
    held = np.zeros(size)
    for _ in range(2):
        pull = max(1.0, left / max(rows, 1)) / prior**2
        held[offset : offset + nt] = pull / b.norms[offset : offset + nt] ** 2
        toward = np.zeros(size)
        toward[offset : offset + nt] = -pull * b.theta0 / b.norms[offset : offset + nt]
        x = np.linalg.solve(gram + np.diag(held + 1e-9), right + toward)
        left = max(float(energy - 2 * right @ x + x @ gram @ x), 0.0)
    return left


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
        spectra.append(s.trace.spectrum(np.column_stack(shapes)))
    A = place_rows(seens, c, spectra)
    A = np.concatenate([A, np.zeros((b.ridge, A.shape[1]))])
    A /= np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    QA, target = b.Q.T @ A, A.T @ b.r
    return float(target @ np.linalg.solve(A.T @ A - QA.T @ QA + 1e-6 * np.eye(len(target)), target))


def _follower(z: Array) -> Array:
    """How far a place has moved since it last turned, up to a limit: what hysteresis and play depend on."""
    turned = np.concatenate([[True], np.diff(np.sign(np.diff(z, prepend=z[0]))) != 0])
    last = np.maximum.accumulate(np.where(turned, np.arange(len(z)), 0))
    return np.clip(z - z[last], -0.6, 0.6)
