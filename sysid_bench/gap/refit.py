"""problem -> the best linear fit: the nominal's own parameters, before any effect is suspected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid_bench.gap.basis import basis
from sysid_bench.gap.descent import Fit, fit, free_parameters
from sysid_bench.gap.motion import seen
from sysid_bench.gap.problem import Point, Problem, evaluate

STEPS, FURTHER = (
    15,
    45,
)  # of the descent; more where it is near the noise: there the last ones decide whether anything is missing
NEAR = 2.0  # rho


def regression_start(problem: Problem, point: Point, rounds: int = 2) -> Point | None:
    """theta by regularised regression on the smoothed motion: reaches the valley that descent from afar misses."""
    best = None
    for _ in range(rounds):
        found = evaluate(problem, point)
        if found is None:
            return best
        seens = [seen(problem, point, *each) for each in zip(problem.traces, found[1], point.starts)]
        b = basis(problem, point, seens, 1.0)
        x = np.linalg.lstsq(b.R, b.Q.T @ b.target, rcond=1e-9)[0] / b.norms
        theta = b.theta0 + x[b.offset : b.offset + len(point.theta)]
        point = best = replace(point, theta=np.clip(np.nan_to_num(theta), -0.9, 2.0))
    return best


def linear_fit(problem: Problem) -> Fit | None:
    """The better of two descents: from the nominal, and from a regression. None where neither can be simulated."""
    known = free_parameters(problem.effects)
    first = fit(problem, problem.nominal(), known, iterations=STEPS)
    if first is not None and first.steps == STEPS and first.rho < NEAR:
        first = fit(problem, first.point, known, iterations=FURTHER) or first
    if first is not None and (problem.on_force or first.rho < 1.3):
        return first
    start = regression_start(problem, problem.nominal())
    second = fit(problem, start, known, iterations=STEPS) if start is not None else None
    fits = [f for f in (first, second) if f is not None]
    return min(fits, key=lambda f: f.rss + f.moved * max(1.0, f.rho)) if fits else None
