"""problem, start -> the best fit: Levenberg-Marquardt with a prior that fades as the residual falls."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sysid_bench.gap.problem import Point, Problem, evaluate
from sysid_bench.mechanics.effect import Effect
from sysid_bench.mechanics.trajectory import Trajectory
from sysid_bench.nouns import Array

TRIES = 6  # damped steps from one place
FUTILE = 0.3  # of the least gain that goes on: a foretold gain below it is not tried
WELL_TOLD = 0.75  # of the foretold gain: the slopes then serve one more step
TOLD = 3  # steps that a descent may take before it is given up as too far behind


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted point: residual rows (R,), what was simulated, covariance of (theta, parameters), and its cost.

    rss: sum of squared whitened rows; R: their number; moved: squared prior-weighted step of theta
    """

    point: Point
    rows: Array
    runs: tuple[Trajectory, ...]
    moved: float
    parameters: tuple[tuple[int, int], ...]
    covariance: Array | None = None
    steps: int = 0

    @property
    def rss(self) -> float:
        return float(self.rows @ self.rows)

    @property
    def rho(self) -> float:
        """Residual energy in the band over the noise floor: 1 where nothing is left."""
        return self.rss / len(self.rows)


@dataclass(frozen=True, eq=False)
class Place:
    """Where a descent stands: its point, residual rows and runs; prior (ntheta,) of theta's step from the nominal."""

    problem: Problem
    parameters: tuple[tuple[int, int], ...]
    prior: Array
    point: Point
    rows: Array
    runs: tuple[Trajectory, ...]

    @property
    def weight(self) -> float:
        """Of the prior: what is left over the noise floor."""
        return max(1.0, float(self.rows @ self.rows) / len(self.rows))

    def cost(self, weight: float) -> float:
        """Residual energy and the prior's share."""
        return float(self.rows @ self.rows + weight * np.sum((self.point.theta / self.prior) ** 2))

    def slopes(self) -> Array:
        """J (R, P): d(simulated rows)/d(theta, parameters, starts); positive parameters by their logarithm."""
        nt, point = len(self.prior), self.point
        J = self.problem.jacobian(point, self.runs, self.parameters)
        for k, (e, p) in enumerate(self.parameters):
            if self.problem.by_log(point.effects[e], p):
                J[:, nt + k] *= point.effects[e].values[p]
        return J

    def normal_equations(self, J: Array) -> tuple[Array, Array]:
        """H, g with H step = g."""
        nt, point, weight = len(self.prior), self.point, self.weight
        # J is d(simulated)/d(...): the rows are measured minus simulated, so H step = J' rows
        with np.errstate(over="ignore", invalid="ignore"):
            H, g = J.T @ J, J.T @ self.rows
        H[np.arange(nt), np.arange(nt)] += weight * self.prior**-2
        g[:nt] -= weight * point.theta / self.prior**2
        stopped = np.flatnonzero(
            (point.theta * g[:nt] > 0) & (np.abs(point.theta / self.problem.prior) >= self.problem.reach)
        )
        H[stopped, :], H[:, stopped], g[stopped] = 0, 0, 0
        H[stopped, stopped] = 1
        return H, g

    def after(self, step: Array) -> Place | None:
        """The place a step further; None where it cannot be simulated."""
        point = moved_point(self.problem, self.point, self.parameters, step)
        found = evaluate(self.problem, point)
        return None if found is None else replace(self, point=point, rows=found[0], runs=found[1])


def fit(
    problem: Problem,
    start: Point,
    parameters: tuple[tuple[int, int], ...] = (),
    iterations: int = 12,
    tolerance: float = 3e-4,
    prior_scale: float = 1.0,
    enough: float = np.inf,
) -> Fit | None:
    """Levenberg-Marquardt on the whitened residual, theta held to the nominal by a prior.

    The prior's weight is the residual over the noise floor: trust the nominal first, the data in the end.
    parameters: (effect, parameter) pairs that are free; enough: energy above which it is of no use: given up where as many
    gains like the last as there are steps left do not reach it. None where the start cannot be simulated.
    """
    start = replace(start, theta=problem.within_reach(start.theta))
    found = evaluate(problem, start)
    if found is None:
        return None
    here = Place(problem, tuple(parameters), problem.prior * prior_scale, start, *found)
    J, H, damping, steps = None, None, 1e-4, 0
    while steps < iterations and not problem.budget.spent:
        again = (
            J is not None
        )  # slopes that foretold the last step well serve once more: a run costs less than its slopes
        if J is None:
            J, steps = here.slopes(), steps + 1
        H, g = here.normal_equations(J)
        if not (np.isfinite(H).all() and np.isfinite(g).all()):
            break  # the derivatives of an unstable motion leave every bound
        cost = here.cost(here.weight)
        least = max(tolerance * cost, 0.5)
        if foretold(H, g, damping) < FUTILE * least:
            break
        better, damping, told = _better(here, H, g, damping, 1 if again else TRIES)
        if better is None:
            if not again:
                break
            J = None
            continue
        gain = cost - better.cost(here.weight)
        J = J if not again and gain > WELL_TOLD * told else None
        here, damping = better, max(damping / 10, 1e-8)
        if gain < least and not again:
            break
        if steps >= TOLD and float(here.rows @ here.rows) - enough > (iterations - steps) * gain:
            break
    moved = float(np.sum((here.point.theta / problem.prior) ** 2))
    covariance = _covariance(H, here.weight)
    return Fit(here.point, here.rows, here.runs, moved, here.parameters, covariance, steps)


def foretold(H: Array, g: Array, damping: float) -> float:
    """By how much the slopes say that a damped step lowers the cost; endless where they cannot say."""
    step = _step(H, g, damping)
    return float(2 * g @ step - step @ H @ step) if np.isfinite(step).all() else np.inf


def _step(H: Array, g: Array, damping: float) -> Array:
    size = np.diag(H) + 1e-12 * np.max(np.diag(H)) + 1e-300
    try:
        return np.linalg.solve(H + damping * np.diag(size), g)
    except np.linalg.LinAlgError:
        return np.full(len(g), np.nan)


def _better(here: Place, H: Array, g: Array, damping: float, tries: int) -> tuple[Place | None, float, float]:
    """The first of some damped steps that lowers the cost, None where none does; the damping then, the gain foretold."""
    weight = here.weight
    cost = here.cost(weight)
    for _ in range(tries):
        step = _step(H, g, damping)
        if not np.isfinite(step).all():
            damping *= 10
            continue
        trial = here.after(step)
        if trial is not None and trial.cost(weight) < cost:
            return trial, damping, float(2 * g @ step - step @ H @ step)
        damping = max(10 * damping, 1e-3)
    return None, damping, 0.0


def _covariance(H: Array | None, weight: float) -> Array | None:
    """Of theta, parameters and starts; None where the normal equations are singular."""
    if H is None or not np.isfinite(H).all():
        return None
    try:
        return np.linalg.inv(H) * weight
    except np.linalg.LinAlgError:
        return None


def moved_point(problem: Problem, point: Point, parameters, step: Array) -> Point:
    """The point after a step in (theta, parameters, starts); parameters stay admissible, factors stay within 2."""
    nt, n = len(point.theta), problem.model.n
    values = [np.array(e.values) for e in point.effects]
    for (e, p), s in zip(parameters, step[nt:]):
        if problem.by_log(point.effects[e], p):
            values[e][p] *= np.exp(np.clip(s, -0.7, 0.7))
        else:
            values[e][p] += s
    effects = tuple(x.with_values(v) if len(v) else x for x, v in zip(point.effects, values))
    tail = step[nt + len(parameters) :].reshape(-1, 2 * n)
    theta = problem.within_reach(point.theta + step[:nt])
    return Point(theta, effects, tuple(x + s for x, s in zip(point.starts, tail)))


def free_parameters(effects: tuple[Effect, ...]) -> tuple[tuple[int, int], ...]:
    """(effect, parameter) pairs that a fit may move."""
    return tuple(
        (e, p) for e, x in enumerate(effects) for p, key in enumerate(x.numeric) if key not in x.held
    )
