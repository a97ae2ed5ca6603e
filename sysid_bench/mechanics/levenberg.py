"""a model's normal equations -> the parameters of least sum over channels of log residual variance.

Maximum likelihood for white noise of unknown variance per channel (diagonal covariance), by Levenberg-Marquardt.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid_bench.nouns import Array, Diverged


@dataclass(frozen=True, eq=False)
class Point:
    """Where a search stands: p, residual variance (ny,), Gauss-Newton matrix J' W J and gradient J' W r.

    prediction: what they were made from, for the caller.
    """

    p: Array
    variance: Array
    hessian: Array
    gradient: Array
    prediction: Any = None

    @property
    def cost(self) -> float:
        """Sum of log variances; infinite for a prediction that is not finite."""
        total = float(np.log(self.variance).sum())
        return total if np.isfinite(total) and np.all(np.isfinite(self.hessian)) else np.inf


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where the search ended, and after how many iterations."""

    point: Point
    iterations: int


FIRST_DAMPING, LARGEST_DAMPING, ROUNDING = 1e-4, 1e10, 1e-12


def minimise(
    evaluate: Callable[[Array], Point], start: Array, max_iterations: int, tolerance: float
) -> Minimum:
    """The minimum near `start`; done when the decrement g' H^-1 g (in units of log-likelihood) < tolerance.

    Raises Diverged where the start has no finite output, or the iterations end before that.
    """
    with np.errstate(all="ignore"):
        point, damping = evaluate(start), 0.0
        if not np.isfinite(point.cost):
            raise Diverged("the model's output is not finite at the start values (an unstable start).")
        for iteration in range(1, max_iterations + 1):
            step, decrement = _step(point, 0.0)
            if 0 <= decrement < tolerance:
                return Minimum(point, iteration)
            if damping > 0:
                step, _ = _step(point, damping)
            trial = evaluate(point.p + step)
            if trial.cost <= point.cost + ROUNDING * abs(point.cost):
                point, damping = trial, 0.0 if damping < FIRST_DAMPING else damping / 10
            else:
                damping = max(10 * damping, FIRST_DAMPING)
                if damping > LARGEST_DAMPING:
                    break
    raise Diverged(f"no minimum after {max_iterations} iterations (last decrement {decrement:.2g}).")


def _step(point: Point, damping: float) -> tuple[Array, float]:
    """Damped Gauss-Newton step (in scaled parameters) and its decrement; least squares where H is singular."""
    scale = np.sqrt(np.maximum(np.diag(point.hessian), np.finfo(float).tiny))
    H = point.hessian / np.outer(scale, scale) + damping * np.eye(len(scale))
    try:
        step = np.linalg.solve(H, point.gradient / scale)
    except np.linalg.LinAlgError:
        step = np.linalg.lstsq(H, point.gradient / scale, rcond=1e-12)[0]
    return step / scale, float(step @ (point.gradient / scale))
