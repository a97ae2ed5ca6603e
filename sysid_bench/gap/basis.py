"""columns of everything that is in the model -> an orthonormal basis: what a suspect has to beat."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from sysid_bench.gap.columns import own_columns, theta_columns
from sysid_bench.gap.motion import Seen as SeenMotion
from sysid_bench.gap.motion import free_response
from sysid_bench.gap.problem import Point, Problem
from sysid_bench.nouns import Array

MOST_ROWS = 6000


@dataclass(frozen=True, eq=False)
class Basis:
    """What suspects have to beat: Q orthonormal over rows and ridge rows, R its triangle, r what is left."""

    Q: Array
    R: Array
    norms: Array
    r: Array
    target: Array
    offset: int  # first column of theta
    theta0: Array
    ridge: int  # rows appended for the prior
    lefts: list[np.ndarray]  # per trace (F, ny): whitened spectrum of what is left
    noise: float = 1.0  # rms of a row beyond all columns, at least 1: what the prior was weighed with
    held: Array = field(default_factory=lambda: np.zeros(0))  # (ntheta,) its rows' entries, in units of norms

    @cached_property
    def inverse(self) -> Array:
        """Pseudoinverse of R."""
        return np.linalg.pinv(self.R, rcond=1e-9)


def basis(problem: Problem, point: Point, seens: list[SeenMotion], prior_scale: float) -> Basis:
    """Orthonormal basis of everything that explains without a new effect, theta held to the nominal by ridge rows."""
    shared, free, targets = [], [], []
    for s in seens:
        free.append(s.trace.rows(free_response(s.linear.assembly, s.trace, problem.model.output)))
        own = np.concatenate([theta_columns(problem, s), own_columns(problem, point, s)], axis=2)
        shared.append(s.trace.rows(own))
        targets.append(s.trace.rows(s.left))
    offset = sum(x.shape[1] for x in free)
    Z = np.concatenate(
        [np.hstack([_placed(thin(f), free, k), thin(z)]) for k, (f, z) in enumerate(zip(free, shared))]
    )
    r = np.concatenate([thin(t) for t in targets])
    norms = np.linalg.norm(Z, axis=0)
    norms[norms == 0] = 1.0  # what nothing moved has no columns
    Z = Z / norms
    Q, _ = np.linalg.qr(Z)
    left = r - Q @ (Q.T @ r)
    noise = np.sqrt(max(1.0, left @ left / len(r)))
    # the prior pulls the total change of theta from the nominal, not the step from this linear model
    theta0, nt = _theta_of(problem, seens[0]), len(problem.entries)
    W = noise / (problem.prior * prior_scale)
    ridge = np.zeros((nt, Z.shape[1]))
    ridge[np.arange(nt), offset + np.arange(nt)] = W / norms[offset : offset + nt]
    Z, r = np.concatenate([Z, ridge]), np.concatenate([r, -W * theta0])
    Q, R = np.linalg.qr(Z)
    x = np.linalg.lstsq(R, Q.T @ r, rcond=1e-9)[0] / norms
    lefts, at = [], 0
    for s, f, z, t in zip(seens, free, shared, targets):
        rows = t - f @ x[at : at + f.shape[1]] - z @ x[offset:]
        lefts.append((rows[: len(rows) // 2] + 1j * rows[len(rows) // 2 :]).reshape(s.trace.F, -1))
        at += f.shape[1]
    held = W / norms[offset : offset + nt]
    return Basis(
        Q,
        R,
        norms,
        r - Q @ (Q.T @ r),
        r,
        offset,
        theta0,
        nt,
        lefts,
        float(noise),
        held,
    )


def _placed(block: Array, blocks: list[Array], k: int) -> Array:
    """A trace's own columns among those of all traces: zero elsewhere."""
    before = sum(x.shape[1] for x in blocks[:k])
    after = sum(x.shape[1] for x in blocks[k + 1 :])
    return np.pad(block, ((0, 0), (before, after)))


def _theta_of(problem: Problem, s: SeenMotion) -> Array:
    n, A = problem.model.n, s.linear.assembly
    now = (A.M[:n, :n], A.D[:n, :n], A.K[:n, :n])
    then = (problem.model.mass, problem.model.damping, problem.model.stiffness)
    return np.array(
        [(now[m] - then[m])[i, j] / scale for (m, i, j), scale in zip(problem.entries, problem.scale)]
    )


def stack(seens: list[SeenMotion], columns: list[np.ndarray]) -> Array:
    return np.concatenate([thin(s.trace.rows(c)) for s, c in zip(seens, columns)])


def thin(rows: Array) -> Array:
    """Few enough rows for a screen: neighbours added with random signs (a count sketch; Clarkson, Woodruff 2013).

    What explains everything before does so after: the map is linear.
    """
    fold, signs = sketch(len(rows))
    if fold == 1:
        return rows
    padded = np.zeros((-(-len(rows) // fold) * fold, *rows.shape[1:]))
    padded[: len(rows)] = rows * signs.reshape(-1, *([1] * (rows.ndim - 1)))
    return padded.reshape(-1, fold, *rows.shape[1:]).sum(axis=1)


def sketch(length: int) -> tuple[int, Array]:
    """(how many neighbours are added, the sign (length,) of each row)."""
    fold = -(-length // MOST_ROWS)
    if fold == 1:
        return 1, np.ones(length)
    return fold, np.random.default_rng(length).choice([-1.0, 1.0], length)
