"""likelihood, a start -> its maximum: Gauss-Newton, damped where a step would lose likelihood."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid_bench.mechanics.information import information_and_gradient
from sysid_bench.mechanics.likelihood import Point, Run, evaluate
from sysid_bench.mechanics.normal_equations import BLIND
from sysid_bench.mechanics.semidefinite import solved
from sysid_bench.nouns import Array, Diverged

TOLERANCE = 1e-3  # Newton decrement: half its value is what the log-likelihood can still gain
SMALL = 100  # times the tolerance: from there on what a step gained tells what the next one will
SMALL_AFTER = 1000  # the same after another step: how much less than that one it foresaw tells, too
LIMIT = 120
FAILURES = 9
ROUNDING = 1e-9  # of the output


@dataclass(frozen=True, eq=False)
class Parameters:
    """theta as a function of what is free: value(phi), slope(phi) (ntheta, nphi). Identity by default."""

    value: Callable[[Array], Array] = field(default=lambda phi: phi)
    slope: Callable[[Array], Array] | None = None


@dataclass(frozen=True, eq=False)
class Maximum:
    """Where the search ended: theta, information H of theta (one last, small step before), cost, iterations."""

    theta: Array
    H: Array
    cost: float
    iterations: int
    converged: bool
    point: Point


def maximise(
    runs: Sequence[Run],
    phi: Array,
    parameters: Parameters | None = None,
    limit: int = LIMIT,
    tolerance: float = TOLERANCE,
    point: Point | None = None,
) -> Maximum:
    """Levenberg-Marquardt from phi; point: the likelihood there, where it is known already.

    Raises Diverged where not even the start can be simulated.
    """
    parameters = parameters or Parameters()
    point = point or evaluate(parameters.value(phi), runs)
    mu, converged, iterations, before = 0.0, False, 0, None
    while iterations < limit:
        iterations += 1
        H, g = information_and_gradient(point, runs)
        h, s = (H, g) if parameters.slope is None else _pulled(H, g, parameters.slope(phi))
        step = _step(h, s, phi, mu, point, runs, parameters, before, tolerance)
        if step is None or step.left < tolerance:
            converged = step is not None or _decrement(h, s) < 100 * tolerance
            phi, point = (phi, point) if step is None else (step.phi, step.point)
            break
        phi, point, mu, before = step.phi, step.point, step.mu, step.foreseen
    return Maximum(point.theta, H, point.cost, iterations, converged or _at_rounding(point, runs), point)


def _at_rounding(point: Point, runs: Sequence[Run]) -> bool:
    """True where the residual is nothing but arithmetic: the record has no noise."""
    return all(
        np.linalg.norm(fit.R) < ROUNDING * np.linalg.norm(run.data.Y[: run.F])
        for fit, run in zip(point.runs, runs)
    )


@dataclass(frozen=True, eq=False)
class _Step:
    phi: Array
    point: Point
    mu: float
    left: float  # Newton decrement that remains to be gained
    foreseen: float | None  # that before the step; a damped one tells nothing


def _pulled(H: Array, g: Array, T: Array) -> tuple[Array, Array]:
    return T.T @ H @ T, T.T @ g


def _decrement(H: Array, g: Array) -> float:
    return float(g @ solved(H, g, BLIND))


def _left(foreseen: float, gained: float, before: float | None, tolerance: float) -> float:
    """Newton decrement after an undamped step that foresaw one of `foreseen` and gained `gained` of log-likelihood, the step
    `before` it having foreseen so much.

    Where Gauss-Newton leaves a share r of the way to the maximum, it gains (1 + r) / 2 of what it foresaw, and the next
    step foresees r^2 of it. Shares of both signs cancel in the first, so the larger of the two counts.
    """
    if foreseen <= 0 or foreseen > (SMALL if before is None else SMALL_AFTER) * tolerance:
        return foreseen
    shares = (2 * gained / foreseen - 1) ** 2, 0.0 if before is None else foreseen / before
    return foreseen * min(max(shares), 1.0)


def _step(H, g, phi, mu, point, runs, parameters, before, tolerance) -> _Step | None:
    """The first damped step that does not lose likelihood; None where none is found."""
    d = np.sqrt(np.maximum(np.diag(H), 1e-300))
    Hs, gs = H / np.outer(d, d), g / d
    for _ in range(FAILURES):
        try:
            move = np.linalg.solve(Hs + mu * np.eye(len(d)), gs)
            trial = evaluate(parameters.value(phi + move / d), runs, point.runs)
        except (Diverged, np.linalg.LinAlgError):
            trial = None
        if trial is not None and trial.cost <= point.cost + 1e-10 * abs(point.cost):
            foreseen, phi = float(move @ gs), phi + move / d
            if mu > 0:  # a damped step gains little whatever is left, and tells nothing of it
                return _Step(phi, trial, 0.0 if mu < 1e-5 else mu / 10, foreseen, None)
            return _Step(
                phi, trial, 0.0, _left(foreseen, point.cost - trial.cost, before, tolerance), foreseen
            )
        mu = max(10 * mu, 1e-3)
    return None
