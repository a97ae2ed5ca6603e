"""several effects found -> each earlier one named again beside the later ones, and what became unnecessary dropped."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from sysid_bench.gap.candidates import Candidate
from sysid_bench.gap.contend import settled
from sysid_bench.gap.descent import Fit, fit, free_parameters
from sysid_bench.gap.price import RICHER_GAINS, Contender, shape_count, subset
from sysid_bench.gap.problem import Budget, Problem
from sysid_bench.mechanics.effect import Effect

NEAR = 2.0  # times the energy with an effect, from which a fit without it may yet find its valley
LOST = 25.0  # energy that an effect must explain to be looked at again


def reconsidered(
    problem: Problem,
    now: Fit,
    cost: Callable[[Fit], float],
    share: float,
    others: Callable[[Fit | None, Fit, Effect], Iterable[Contender]],
) -> Fit:
    """Name each earlier effect again, given the later ones.

    others(without, now, effect): what may stand in its place; without is None where the rest cannot be simulated alone
    share: of what is left, by which another name must win
    """
    for k in range(len(problem.model.effects), len(now.point.effects) - 1):
        effect = now.point.effects[k]
        if problem.budget.spent:
            break
        without = _without(problem, now, effect)
        if without is not None and without.rss - now.rss < LOST:
            continue
        best = cost(now)
        for other in others(without, now, effect):
            margin = max(20, share * (now.rss - len(now.rows)))
            if without is not None and _only_rounded(other.effect, effect):
                margin = max(margin, 2 * RICHER_GAINS * (without.rss - now.rss))
            simpler = shape_count(other.fit.point.effects) < shape_count(now.point.effects)
            if other.cost < best + (margin if simpler and not other.is_decoy else -margin):
                now, best = other.fit, other.cost
    return now


def _only_rounded(simple: Effect, rich: Effect) -> bool:
    """True for two laws of one sliding friction that round its sign, of which the richer may only round it otherwise."""
    return subset(simple, rich) and all("speed" in e.numeric for e in (simple, rich))


def pruned(problem: Problem, now: Fit, needless: Callable[[Fit, Fit], bool]) -> Fit:
    """Drop effects that the others have made unnecessary: those whose fit without them is needless(without, now).

    The latest first: it may only have led an earlier one into its valley. No budget ends this: a name too many is wrong.
    """
    problem = replace(problem, budget=Budget())
    base = len(problem.model.effects)
    for k in reversed(range(base, len(now.point.effects))):
        if len(now.point.effects) < base + 2:
            break
        without = _without(problem, now, now.point.effects[k], NEAR * now.rss)
        if without is not None and not needless(without, now) and without.rss < NEAR * now.rss:
            without = settled(problem, without, now)
        if without is not None and needless(without, now):
            now = without
    return now


def is_it(candidate: Candidate, effect: Effect) -> bool:
    """True where a candidate is that effect at that place."""
    return candidate.effect.name == effect.name and candidate.place == effect.dof


def _without(problem: Problem, now: Fit, effect: Effect, enough: float = np.inf) -> Fit | None:
    rest = tuple(x for x in now.point.effects if x is not effect)
    return fit(problem, replace(now.point, effects=rest), free_parameters(rest), 6, enough=enough)
