"""problem, point -> the same problem with steps so small that its simulation's own error lies below the noise.

The steps between samples are few, for speed. Few samples per period, strong curvature and little noise together, and
what the integration misses stands above the noise floor: a second effect would be named for it.
"""

from __future__ import annotations

from dataclasses import replace

from sysid_bench.gap.descent import Fit, fit
from sysid_bench.gap.inverse import ForceProblem
from sysid_bench.gap.problem import Point, Problem, evaluate

FINEST = 4  # times the usual number of steps
TOLERATED = (
    0.02,
    0.1,
)  # change of the residual when steps are halved: of the noise floor, and of what is left above it


def finer(problem: Problem, point: Point) -> Problem:
    """The problem on steps whose halving would change the residual by little."""
    if isinstance(problem, ForceProblem) or len(point.effects) == 0:
        return problem
    while problem.fineness < FINEST:
        twice = replace(problem, fineness=2 * problem.fineness)
        coarse, fine = evaluate(problem, point), evaluate(twice, point)
        if coarse is None or fine is None:
            return problem
        rho = min(float(x[0] @ x[0]) for x in (coarse, fine)) / len(fine[0])
        change = fine[0] - coarse[0]
        floor, left = TOLERATED
        if float(change @ change) / len(change) < floor + left * max(rho - 1, 0.0):
            return problem
        problem = twice
    return problem


def on_finer_steps(problem: Problem, found: Fit) -> tuple[Problem, Fit]:
    """The problem on steps that are small enough for a fit, and that fit on them."""
    fine = finer(problem, found.point)
    if fine is problem:
        return problem, found
    again = fit(fine, found.point, found.parameters)
    return (problem, found) if again is None else (fine, again)
