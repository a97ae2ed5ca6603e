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
    """Columns A (rows, m) made ready; groups: (first, last, make, price) of each suspect. A of b's rows is normed in place."""
    if len(A) < len(b.r):
        A = np.concatenate([A, np.zeros((b.ridge, A.shape[1]))])
    norms = np.sqrt(np.maximum(_squares(A), 1e-300))
    A /= norms
    QA = b.Q.T @ A
    alone = (_squares(A) - _squares(QA)).reshape(-1, 1, 1)
    grams = [
        alone[i] if j == i + 1 else A[:, i:j].T @ A[:, i:j] - QA[:, i:j].T @ QA[:, i:j]
        for i, j, _, _ in groups
    ]
    return Shelf(A, QA, norms, grams, groups, decoy)


def _squares(A: Array) -> Array:
    return np.einsum("ij,ij->j", A, A)


def judged(problem: Problem, b: Basis, shelf: Shelf, known: Array | None = None) -> list[Candidate]:
    """Candidates of a shelf. known (rows, k): orthonormal, beyond the basis: what is explained already."""
    r, KA = b.r, None
    if known is not None:
        KA = known.T @ shelf.A
        r = r - known @ (known.T @ r)
    target, nt = shelf.A.T @ r, len(problem.entries)
    y, explained = _small_fits(shelf, target, KA)
    shares = np.add.reduceat(shelf.QA * y, [first for first, _, _, _ in shelf.groups], axis=1)
    X = b.inverse @ ((b.Q.T @ b.target)[:, None] - shares) / b.norms[:, None]
    theta = np.clip(b.theta0[:, None] + X[b.offset : b.offset + nt], -0.95, 2.0).T
    price, coefficients, out = np.log(len(b.r)), y / shelf.norms, []
    for k, (first, last, make, parameters) in enumerate(shelf.groups):
        c, gained = coefficients[first:last], float(explained[k])
        effect = make(c) if np.isfinite(gained) else None
        if effect is not None:
            unit = float(shelf.grams[k][0, 0] * shelf.norms[first] ** 2)
            score = gained - parameters * price
            out.append(Candidate(effect, gained, score, c, theta[k], shelf.decoy[k], unit_energy=unit))
    return out


def _small_fits(shelf: Shelf, target: Array, KA: Array | None) -> tuple[Array, Array]:
    """(y (m,), energy (groups,)): each group's own least squares, and what it explains; KA: what is known of the columns."""
    y, explained = np.empty(len(target)), np.empty(len(shelf.groups))
    alone = [k for k, (first, last, _, _) in enumerate(shelf.groups) if last == first + 1]
    at = [shelf.groups[k][0] for k in alone]
    S, t = np.array([shelf.grams[k].item() for k in alone]) + 1e-6, target[at]
    if KA is not None:
        S = S - _squares(KA[:, at])
    y[at] = t / S
    explained[alone] = t * y[at]
    for k in sorted(set(range(len(shelf.groups))).difference(alone)):
        first, last, _, _ = shelf.groups[k]
        S, t = shelf.grams[k] + 1e-6 * np.eye(last - first), target[first:last]
        if KA is not None:
            S = S - KA[:, first:last].T @ KA[:, first:last]
        y[first:last] = one = np.linalg.solve(S, t)
        explained[k] = 2 * one @ t - one @ S @ one
    return y, explained


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
