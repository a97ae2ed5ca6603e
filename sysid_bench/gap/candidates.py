"""columns of suspects -> candidates with their evidence: one small least squares each, beyond the basis."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sysid_bench.gap.basis import Basis
from sysid_bench.gap.motion import Seen as SeenMotion
from sysid_bench.gap.problem import Point, Problem
from sysid_bench.mechanics.effect import Effect
from sysid_bench.nouns import Array, NotApplicable


@dataclass(frozen=True, eq=False)
class Candidate:
    """A suspect with its evidence. explained: energy beyond what M, D, K explain; score: minus the price of parameters."""

    effect: Effect
    explained: float
    score: float
    coefficients: Array
    theta: Array
    decoy: bool
    origin: Effect | None = None  # before it was polished
    unit_energy: float = 0.0  # energy that its first unit form adds beyond M, D, K

    @property
    def place(self):
        return self.effect.dof


@dataclass(frozen=True, eq=False)
class Screen:
    """candidates, best first; left: energy that M, D, K leave; by_place: share that some force at a place explains."""

    candidates: list[Candidate]
    left: float
    by_place: dict
    rows: int
    lefts: list[np.ndarray]
    basis: Basis | None = None  # of a free run: what polishing and pairs go on from
    seens: list[SeenMotion] = field(default_factory=list)
    point: Point | None = None
    shelves: list[Shelf] = field(default_factory=list)

    @property
    def ground(self) -> tuple[Basis, Point]:
        """What suspects had to beat and where it was taken. Raises NotApplicable for a screen on the force."""
        if self.basis is None or self.point is None:
            raise NotApplicable("effects are polished on a screen of free runs, not on one of forces.")
        return self.basis, self.point

    def promise(self, explained: float) -> float:
        """rho that is left where so much is explained."""
        return max((self.left - explained) / self.rows, 1.0)


@dataclass(frozen=True, eq=False)
class Shelf:
    """Columns that were judged together: A (rows, m) of unit norm, QA their share in the basis, groups of suspects.

    grams: per group, the Gram matrix of its columns beyond the basis
    """

    A: Array
    QA: Array
    norms: Array
    grams: list[Array]
    groups: list
    decoy: list[bool]


def shelved(b: Basis, A: Array, groups: list, decoy: list[bool]) -> Shelf:
    """Columns A (rows, m) made ready; groups: (first, last, make, price) of each suspect."""
    A = np.concatenate([A, np.zeros((b.ridge, A.shape[1]))])
    norms = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    A = A / norms
    QA = b.Q.T @ A
    grams = [_square(A[:, i:j]) - _square(QA[:, i:j]) for i, j, _, _ in groups]
    return Shelf(A, QA, norms, grams, groups, decoy)


def _square(A: Array) -> Array:
    return A.T @ A


def judged(problem: Problem, b: Basis, shelf: Shelf, known: Array | None = None) -> list[Candidate]:
    """Candidates of a shelf. known (rows, k): orthonormal, beyond the basis: what is explained already."""
    r, KA = b.r, None
    if known is not None:
        KA = known.T @ shelf.A
        r = r - known @ (known.T @ r)
    target = shelf.A.T @ r
    price, nt = np.log(len(b.r)), len(problem.entries)
    solve, projected, QA = np.linalg.pinv(b.R, rcond=1e-9), b.Q.T @ b.target, shelf.QA
    out = []
    for (first, last, make, parameters), gram, is_decoy in zip(shelf.groups, shelf.grams, shelf.decoy):
        S = gram + 1e-6 * np.eye(last - first)
        if KA is not None:
            S = S - _square(KA[:, first:last])
        y = np.linalg.solve(S, target[first:last])
        explained = float(2 * y @ target[first:last] - y @ S @ y)
        if not np.isfinite(explained):
            continue
        c = y / shelf.norms[first:last]
        effect = make(c)
        if effect is None:
            continue
        x = solve @ (projected - QA[:, first:last] @ y) / b.norms
        theta = np.clip(b.theta0 + x[b.offset : b.offset + nt], -0.95, 2.0)
        unit = float(gram[0, 0] * shelf.norms[first] ** 2)
        out.append(
            Candidate(effect, explained, explained - parameters * price, c, theta, is_decoy, unit_energy=unit)
        )
    return out


def judge(problem: Problem, b: Basis, A: Array, groups: list, decoy: list[bool]) -> list[Candidate]:
    """Candidates of the columns A (rows, m); groups: (first, last, make, price) of each suspect."""
    return judged(problem, b, shelved(b, A, groups, decoy))


def beside(problem: Problem, screened: Screen, columns: Array) -> list[Candidate]:
    """All suspects again, best first, given that columns (rows, k), beyond the basis, explain what they can."""
    known, _ = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))
    found = [x for one in screened.shelves for x in judged(problem, screened.ground[0], one, known)]
    return sorted(found, key=lambda x: -x.score)


def free_count(effect: Effect) -> int:
    return sum(key not in effect.held and key not in ("speed", "damping") for key in effect.numeric)
