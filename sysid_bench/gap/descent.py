"""problem, start -> the best fit: Levenberg-Marquardt with a prior that fades as the residual falls."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sysid_bench.gap.problem import Point, Problem, evaluate
from sysid_bench.mechanics.effect import Effect
from sysid_bench.mechanics.trajectory import Trajectory
from sysid_bench.nouns import Array


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

    def normal_equations(self) -> tuple[Array, Array]:
        """H, g with H step = g; positive parameters by their logarithm."""
        nt, point, weight = len(self.prior), self.point, self.weight
        J = self.problem.jacobian(point, self.runs, self.parameters)
        for k, (e, p) in enumerate(self.parameters):
            if self.problem.by_log(point.effects[e], p):
                J[:, nt + k] *= point.effects[e].values[p]
        # J is d(simulated)/d(...): the rows are measured minus simulated, so H step = J' rows
        with np.errstate(over="ignore", invalid="ignore"):
            H, g = J.T @ J, J.T @ self.rows
        H[np.arange(nt), np.arange(nt)] += weight * self.prior**-2
        g[:nt] -= weight * point.theta / self.prior**2
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
) -> Fit | None:
    """Levenberg-Marquardt on the whitened residual, theta held to the nominal by a prior.

    The prior's weight is the residual over the noise floor: trust the nominal first, the data in the end.
    parameters: (effect, parameter) pairs that are free. None where the start cannot be simulated.
    """
    found = evaluate(problem, start)
    if found is None:
        return None
    here = Place(problem, tuple(parameters), problem.prior * prior_scale, start, *found)
    H, damping, steps = None, 1e-4, 0
    while steps < iterations:
        steps += 1
        H, g = here.normal_equations()
        if not (np.isfinite(H).all() and np.isfinite(g).all()):
            break  # the derivatives of an unstable motion leave every bound
        better, damping = _better(here, H, g, damping)
        if better is None:
            break
        gain = here.cost(here.weight) - better.cost(here.weight)
        here, damping = better, max(damping / 10, 1e-8)
        if gain < max(tolerance * here.cost(here.weight), 0.5):
            break
    moved = float(np.sum((here.point.theta / problem.prior) ** 2))
    covariance = _covariance(H, here.weight)
    return Fit(here.point, here.rows, here.runs, moved, here.parameters, covariance, steps)


def _better(here: Place, H: Array, g: Array, damping: float) -> tuple[Place | None, float]:
    """The first of six damped steps that lowers the cost, None where none does; and the damping then."""
    weight = here.weight
    cost = here.cost(weight)
    size = np.diag(H) + 1e-12 * np.max(np.diag(H)) + 1e-300
    for _ in range(6):
        try:
            step = np.linalg.solve(H + damping * np.diag(size), g)
        except np.linalg.LinAlgError:
            step = np.full(len(g), np.nan)
        if not np.isfinite(step).all():
            damping *= 10
            continue
        trial = here.after(step)
        if trial is not None and trial.cost(weight) < cost:
            return trial, damping
        damping = max(10 * damping, 1e-3)
    return None, damping


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
    return Point(point.theta + step[:nt], effects, tuple(x + s for x, s in zip(point.starts, tail)))


def free_parameters(effects: tuple[Effect, ...]) -> tuple[tuple[int, int], ...]:
    """(effect, parameter) pairs that a fit may move."""
    return tuple(
        (e, p) for e, x in enumerate(effects) for p, key in enumerate(x.numeric) if key not in x.held
    )
