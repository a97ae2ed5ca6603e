"""a run of the likelihood -> where to start it: linear least squares, then refined instrumental variables.

An instrumental step is taken while the likelihood gains from it: near the optimum each is worth several
Gauss-Newton steps, at a poor signal to noise ratio they run away.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sysid_bench.mechanics.likelihood import Run, evaluate
from sysid_bench.mechanics.linear_start import equation_error_normal
from sysid_bench.mechanics.refined_iv import refine
from sysid_bench.nouns import Array, Diverged

STEPS = 3
SETTLED = 30.0  # gain of log-likelihood below which Gauss-Newton is the better next step


def linear_start(runs: list[Run], free: NDArray[np.bool_], known: Array) -> Array:
    """theta by equation-error least squares over all runs, entries that are not free kept at `known`.

    Raises NotApplicable where not every degree of freedom has its own sensor.
    """
    parts = [equation_error_normal(run.data, run.maps, run.F) for run in runs]
    H, g = sum(H for H, _ in parts), sum(g for _, g in parts)
    theta = np.array(known, dtype=float)
    right = g[free] - H[np.ix_(free, ~free)] @ theta[~free]
    d = np.sqrt(np.maximum(np.diag(H)[free], 1e-300))
    theta[free] = np.linalg.lstsq(H[np.ix_(free, free)] / np.outer(d, d), right / d, rcond=1e-14)[0] / d
    return theta


def refined_start(runs: list[Run], theta: Array) -> Array:
    """theta after instrumental-variable steps, as long as the likelihood gains from them."""
    if len(runs) > 1:
        return theta
    run, cost = runs[0], _cost(theta, runs)
    for _ in range(STEPS):
        try:
            trial = refine(run.data, run.maps, run.F, theta, steps=1)[0]
        except Diverged:
            return theta
        trial_cost = _cost(trial, runs)
        if not trial_cost < cost:
            return theta
        gain, theta, cost = cost - trial_cost, trial, trial_cost
        if gain < SETTLED:
            return theta
    return theta


def _cost(theta: Array, runs: list[Run]) -> float:
    try:
        return evaluate(theta, runs).cost
    except Diverged:
        return np.inf
