"""what no name explains -> how much of it some force of (x, v), of the way since the last turn, or any force could explain.

The flexible reference bounds what a name could explain: where it gains nothing, an unmeasured force or noise is left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.gap.basis import basis, thin
from sysid_bench.gap.columns import force_columns
from sysid_bench.gap.descent import Fit
from sysid_bench.gap.locate import explained_by_place
from sysid_bench.gap.motion import seen
from sysid_bench.gap.problem import Problem
from sysid_bench.mechanics.effect import direction
from sysid_bench.nouns import Array

PRIOR = 0.7
PLACES = 3


@dataclass(frozen=True)
class Reference:
    """Of what the refit leaves above the noise: share that a force of the state at `dof` explains; that any force there does."""

    dof: int | tuple[int, int]
    of_state: float
    of_any_force: float


def flexible_reference(problem: Problem, fit: Fit) -> list[Reference]:
    """The three places that explain most, best first. Free-run problems only."""
    seens = [
        seen(problem, fit.point, trace, run, x0)
        for trace, run, x0 in zip(problem.traces, fit.runs, fit.point.starts)
    ]
    b = basis(problem, fit.point, seens, PRIOR)
    left = max(float(b.r @ b.r) - len(b.r), 1e-9)
    by_place = explained_by_place(problem, fit.point, seens, b, PRIOR)
    best = sorted(by_place, key=lambda place: -by_place[place])[: 2 * PLACES]
    found = [
        Reference(place, _share(problem, seens, b, place, left), float(np.clip(by_place[place], 0, 1)))
        for place in best
    ]
    return sorted(found, key=lambda r: -r.of_state)[:PLACES]


def _share(problem: Problem, seens, b, place, left: float) -> float:
    c, blocks = direction(place, problem.model.n), []
    for s in seens:
        columns = force_columns(s, c, shapes(s.q @ c, s.v @ c))
        blocks.append(thin(s.trace.rows(columns)))
    A = np.concatenate([*blocks, np.zeros((b.ridge, blocks[0].shape[1]))])
    A = A / np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    A = A - b.Q @ (b.Q.T @ A)
    Q, R = np.linalg.qr(A)
    Q = Q[:, np.abs(np.diag(R)) > 1e-6]
    explained = float(np.sum((Q.T @ b.r) ** 2)) - Q.shape[1]
    return float(np.clip(explained / left, 0, 1))


def shapes(x: Array, v: Array) -> Array:
    """(N, 35) a general force of displacement and velocity: products up to the fifth power, bends, and memory."""
    z, w = x / max(x.std(), 1e-300), v / max(v.std(), 1e-300)
    products = [z**i * w**j for i in range(6) for j in range(6 - i) if i + j > 1]
    bends = [np.clip(z, -g, g) for g in (0.3, 0.7, 1.2, 2.0)] + [
        np.tanh(w / g) for g in (0.02, 0.1, 0.4, 1.0)
    ]
    return np.column_stack(
        [*products, *bends, np.abs(z), np.abs(w), *(_way(z, g) for g in (0.2, 0.6, 1.2)), z * 0 + 1]
    )


def _way(z: Array, limit: float) -> Array:
    """Displacement since the last turn, up to a limit."""
    turned = np.concatenate([[True], np.diff(np.sign(np.diff(z, prepend=z[0]))) != 0])
    last = np.maximum.accumulate(np.where(turned, np.arange(len(z)), 0))
    return np.clip(z - z[last], -limit, limit)
