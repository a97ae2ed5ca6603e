"""a refit -> where suspects are looked for from: the refit itself, the nominal where the refit bent M, D, K to swallow an effect."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sysid_bench.gap.candidates import Screen
from sysid_bench.gap.descent import Fit
from sysid_bench.gap.finalists import polished_screen
from sysid_bench.gap.price import noticeable
from sysid_bench.gap.problem import Problem, evaluate
from sysid_bench.gap.screen import PRIOR_SCALE, screen

CLEAR = 1.5  # rho of a refit that leaves a gap nobody overlooks
STRONG, BENT = 20.0, 1.1  # rho, and step in priors, from which a refit has swallowed part of an effect
# Of what a refit leaves: where M, D, K leave less in a screen, it takes them for more than they are.
MISLED = 0.25


def first_views(problem: Problem, linear: Fit, catalogue) -> Iterator[Screen]:
    """Screens from the refit and, where it is bent, from the nominal, what promises more first; then one that holds on to it.

    Along a motion that few forces drive, many M, D, K are as good; where they explain there what no simulation does,
    the nominal is trusted as far as it is wrong.
    """
    if linear.rho < CLEAR or bend(problem, linear) < BENT / 2:
        yield view(problem, linear, catalogue)
        return
    nominal = at_nominal(problem, linear)
    if linear.rho < STRONG or bend(problem, linear) < BENT:
        yield (first := view(problem, linear, catalogue))
        yield (second := view(problem, nominal, catalogue))
    else:
        first, second = (view(problem, ground, catalogue) for ground in (linear, nominal))
        yield from sorted(
            (first, second), key=lambda x: x.left - max((c.explained for c in x.candidates), default=0.0)
        )
    if min(first.left, second.left) < MISLED * linear.rss:
        yield view(problem, nominal, catalogue, PRIOR_SCALE / np.sqrt(max(nominal.rho, 1.0)))


def view(problem: Problem, ground: Fit, catalogue, prior_scale: float = PRIOR_SCALE) -> Screen:
    """The suspects as seen from a ground, the best of them polished."""
    screened = screen(problem, ground, catalogue, prior_scale)
    return polished_screen(problem, screened, 0.3 * noticeable(len(ground.rows)))


def ground_of(problem: Problem, base: Fit) -> Fit:
    """Where to screen from: the nominal parameters where the refit bent them to swallow a strong effect."""
    if base.rho < STRONG or bend(problem, base) < BENT:
        return base
    return at_nominal(problem, base)


def at_nominal(problem: Problem, base: Fit) -> Fit:
    """The same with the nominal parameters."""
    point = replace(base.point, theta=np.zeros_like(base.point.theta))
    found = evaluate(problem, point)
    return base if found is None else replace(base, point=point, rows=found[0], runs=found[1])


def bend(problem: Problem, base: Fit) -> float:
    """The largest step of an entry, in units of its prior."""
    return float(np.max(np.abs(base.point.theta / problem.prior), initial=0.0))
