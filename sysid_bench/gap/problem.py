"""nominal model, traces -> the problem of a fit: which entries may move, how far they are believed to be off."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from sysid_bench.gap.free_run import free_run, free_run_jacobian
from sysid_bench.gap.traces import Trace
from sysid_bench.mechanics.effect import POSITIVE, Effect, as_effects
from sysid_bench.mechanics.trajectory import Trajectory
from sysid_bench.nouns import Array, Diverged, Model

MATRICES = ("mass", "damping", "stiffness")


# How far a nominal entry is believed to be off, relative: mass, damping, stiffness.
PRIOR = np.array([0.3, 0.6, 0.3])


@dataclass(frozen=True, eq=False)
class Point:
    """Where a fit stands: theta (ntheta,) relative to the nominal, effects, x0 per trace (2 n,)."""

    theta: Array
    effects: tuple[Effect, ...]
    starts: tuple[Array, ...]


@dataclass(eq=False)
class Budget:
    """How much a search may simulate, in microseconds of one core as they are counted here: the same on every machine.

    A small step of a run costs RUN_US, its derivatives by P columns of nx states RUN_US + SLOPE_US P nx.
    """

    left: float = np.inf
    kept: float = 0.0  # for later: what comes now ends here

    @property
    def spent(self) -> bool:
        return self.left <= self.kept

    def keep(self, share: float) -> None:
        """Keep a share of what is left for later; 0 sets free what was kept."""
        self.kept = share * self.left if share and np.isfinite(self.left) else 0.0

    def run(self, runs: tuple[Trajectory, ...]) -> None:
        self.left -= RUN_US * sum(len(one.X) for one in runs)

    def slopes(self, runs: tuple[Trajectory, ...], columns: int) -> None:
        self.left -= sum(len(one.X) * (RUN_US + SLOPE_US * columns * one.X.shape[1]) for one in runs)


RUN_US, SLOPE_US = 0.5, 0.01
SEARCH_S, SEARCH_S_PER_DOF = 4.0, 4.5  # for 10 000 samples; longer records have as many times more


def budget_of(n: int, samples: int) -> Budget:
    """The budget of n degrees of freedom and so many samples of training."""
    return Budget(1e6 * (SEARCH_S + SEARCH_S_PER_DOF * n) * max(1.0, samples / 10_000))


@dataclass(frozen=True, eq=False)
class Problem:
    """The nominal model, which of its entries may move, and the traces to fit.

    entries (matrix 0|1|2, row, column); scale (ntheta,) size of each entry in SI; fineness: times the usual number of
    steps between samples; quick: one alone, to compare what lies far apart; reach: how far theta may go, in priors
    """

    model: Model
    traces: tuple[Trace, ...]
    entries: tuple[tuple[int, int, int], ...]
    scale: Array
    fineness: int = field(default=1, kw_only=True)
    quick: bool = field(default=False, kw_only=True)
    reach: float = field(default=np.inf, kw_only=True)
    budget: Budget = field(default_factory=Budget, kw_only=True)

    @property
    def prior(self) -> Array:
        return PRIOR[[m for m, _, _ in self.entries]]

    @property
    def rows(self) -> int:
        return sum(2 * t.F * t.y.shape[1] for t in self.traces)

    def within_reach(self, theta: Array) -> Array:
        """theta, brought back to where it may go."""
        return np.clip(theta, -self.reach * self.prior, self.reach * self.prior)

    @property
    def held(self) -> bool:
        """True where the simulation is held near a measured motion."""
        return any(t.pull is not None for t in self.traces)

    def matrices(self, theta: Array) -> tuple[Array, Array, Array]:
        """M, D, K at theta."""
        out = [np.array(getattr(self.model, name)) for name in MATRICES]
        for value, (m, i, j), s in zip(theta, self.entries, self.scale):
            out[m][i, j] += value * s
            if i != j:
                out[m][j, i] += value * s
        return out[0], out[1], out[2]

    def at(self, theta: Array, effects: tuple[Effect, ...]) -> Model | None:
        """The model at theta, with effects; None where its mass is not positive."""
        M, D, K = self.matrices(theta)
        if np.linalg.eigvalsh(M)[0] <= 1e-6 * np.abs(M).max():
            return None
        return replace(self.model, mass=M, damping=D, stiffness=K, effects=effects)

    def model_at(self, point: Point) -> Model:
        """The model at a point that has been simulated. Raises Diverged where its mass is not positive."""
        model = self.at(point.theta, point.effects)
        if model is None:
            raise Diverged("the gap search stands where the mass is not positive.")
        return model

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects that the model has already."""
        return as_effects(self.model.effects)

    def nominal(self) -> Point:
        return Point(np.zeros(len(self.entries)), self.effects, self.begins)

    @property
    def begins(self) -> tuple[Array, ...]:
        """(2 n,) per trace: at rest, or as a part of a longer one was measured to begin."""
        return tuple(np.zeros(2 * self.model.n) if t.begins is None else t.begins for t in self.traces)

    def on(self, traces: tuple[Trace, ...]) -> Problem:
        """The same problem on other traces."""
        return replace(self, traces=traces)

    on_force: ClassVar[bool] = False  # True where the force is compared, not the output

    def by_log(self, effect: Effect, p: int) -> bool:
        """True where a parameter is stepped by its logarithm: those that must be positive."""
        return effect.knobs[effect.numeric[p]].range == POSITIVE

    def evaluate(self, point: Point) -> tuple[Array, tuple] | None:
        """Whitened residual rows and the runs; None where the model is inadmissible or its motion leaves every bound."""
        found = free_run(self, point)
        if found is not None:
            self.budget.run(found[1])
        return found

    def jacobian(self, point: Point, runs, parameters) -> Array:
        """(R, ntheta + parameters + 2 n traces): minus the derivative of the rows; the starts come last, per trace."""
        self.budget.slopes(runs, len(self.entries) + len(parameters) + 2 * self.model.n)
        return free_run_jacobian(self, point, runs, parameters)


def evaluate(problem: Problem, point: Point) -> tuple[Array, tuple[Trajectory, ...]] | None:
    """See Problem.evaluate."""
    return problem.evaluate(point)


def frequency_range(model: Model, trace: Trace) -> tuple[float, float]:
    """(low, high) rad/s of the plant's own frequencies; of a free mass, from three per record to a tenth of Nyquist."""
    M, _, K = model.matrices
    squared = np.abs(np.linalg.eigvals(np.linalg.solve(M, K)))
    omega = np.sqrt(squared)
    low, high = 6 * np.pi / (trace.N * trace.h), 0.1 * np.pi / trace.h
    if omega.max() < low:
        return low, high
    return max(float(omega.min()), low, 1e-3 * float(omega.max())), float(omega.max())


def problem_of(model: Model, traces: tuple[Trace, ...]) -> Problem:
    """Entries that are free: the nominal's nonzero pattern, the diagonals, damping wherever a spring is."""
    M, D, K = model.matrices
    entries, scale = [], []
    for m, X in enumerate((M, D, K)):
        mask = model.free.get(MATRICES[m], np.ones_like(M, dtype=bool))
        for i in range(model.n):
            for j in range(i, model.n):
                linked = X[i, j] != 0 or (m == 1 and K[i, j] != 0)
                if mask[i, j] and (i == j or linked):
                    entries.append((m, i, j))
                    size = 0.2 * np.sqrt(abs(X[i, i] * X[j, j]))
                    scale.append(
                        max(
                            abs(X[i, j]),
                            size,
                            _natural(m, model, i, j),
                            _free_damping(m, model, traces, i, j),
                        )
                    )
    budget = budget_of(model.n, sum(t.N for t in traces))
    return Problem(model, traces, tuple(entries), np.array(scale), budget=budget)


def _free_damping(m: int, model: Model, traces: tuple[Trace, ...], i: int, j: int) -> float:
    """A size for the damping of a mass that no spring holds: a tenth of what would stop it in mid band."""
    M, _, K = model.matrices
    if m != 1 or i != j or K[i, i] != 0:
        return 0.0
    low, high = frequency_range(model, traces[0])
    return float(0.1 * M[i, i] * np.sqrt(low * high))


def _natural(m: int, model: Model, i: int, j: int) -> float:
    """A size for an entry whose nominal is zero: 2 % of critical damping; a hundredth of the stiffest spring."""
    M, _, K = model.matrices
    K = np.abs(K)
    if m == 0:
        return 1e-3 * M.max()
    if m == 1:
        return 0.02 * np.sqrt(max(K[i, i], 1e-3 * K.max()) * M[i, i]) + 1e-12
    return 0.01 * K.max() + 1e-12
