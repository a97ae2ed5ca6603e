"""fit on the force, catalogue -> the effects that are missing, kept by what they gain on held-out blocks.

On a machine what is left is never noise, so a likelihood would add shapes without end: held-out blocks decide, and of
explanations that they find as good the simplest name is kept.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from sysid_bench.gap.again import is_it, pruned, reconsidered
from sysid_bench.gap.candidates import Candidate
from sysid_bench.gap.contend import best_start
from sysid_bench.gap.descent import Fit, fit, free_parameters
from sysid_bench.gap.finalists import shortlist
from sysid_bench.gap.force_screen import screen_on_force
from sysid_bench.gap.held_out import block_losses, earns_on_force, force_of, held_out_cost, simplest
from sysid_bench.gap.inverse import ForceProblem
from sysid_bench.gap.look import UNCLEAN, by_batches
from sysid_bench.gap.price import DECOY_NAMES, Contender, shape_count, subset
from sysid_bench.gap.problem import Point
from sysid_bench.gap.story import Round, Rules, Story
from sysid_bench.mechanics.effect import Effect

# Of the cost, by which a step on the force must lower it: a friction smoothed too steeply lies on a plateau.
TIGHT = 1e-5
CLOSE = 20.0  # of the price: explanations that differ by less are as good
MOST_DAMPED = 0.7  # damping ratio from which a hidden mass is no mode


def choose_on_force(
    problem: ForceProblem, linear: Fit, catalogue: list[type[Effect]], rules: Rules | None = None
) -> Story:
    """The story of the missing effects. Pure: nothing but its arguments decides."""
    rules = rules or Rules()
    linear_gap = max(linear.rss - len(linear.rows), 1.0)
    first = look(problem, linear, catalogue, rules)
    story = _told(problem, Story(linear, linear), first, catalogue, rules)
    shape = first.chosen
    if shape is None or not shape.is_decoy or (shape.fit.rss - len(shape.fit.rows)) < UNCLEAN * linear_gap:
        return story
    # No single force explains it: an unnamed shape may stand for the sum of two named ones.
    named = next((c for c in first.contenders if not c.is_decoy), None)
    if named is None:
        return story
    other = _told(problem, Story(linear, linear), replace(first, chosen=named), catalogue, rules)
    return other if other.fit.rho < 1.3 and not other.ends_unnamed else story


def refine(problem: ForceProblem, base: Fit, candidate: Candidate, iterations: int = 12) -> Contender | None:
    """Fit one more effect on the force, jointly with everything. None where it fails or ends inadmissible."""
    effects = (*base.point.effects, candidate.effect)
    thetas = [base.point.theta, candidate.theta, np.zeros_like(base.point.theta)]
    choices = [Point(np.asarray(theta, dtype=float), effects, base.point.starts) for theta in thetas]
    start = best_start(problem, choices)
    if start is None:
        return None
    found = fit(problem, start[1], free_parameters(effects), iterations, TIGHT)
    if found is None or _swings_not(found.point.effects[-1]):
        return None
    return Contender(found, candidate, held_out_cost(problem, found))


def _swings_not(effect: Effect) -> bool:
    """True of a hidden mass that creeps: a mode by name only, and on a machine it mends the shape of anything."""
    return effect.name == "extra_mode" and effect.values[effect.numeric.index("damping_ratio")] > MOST_DAMPED


def _rank(one: Fit, effect: Effect) -> tuple:
    """Names before shapes without one, few parameters before many; a lag only where its loss of gain is seen."""
    return effect.name in DECOY_NAMES, shape_count(one.point.effects), effect.name == "actuator_lag"


def _moves(one: Fit) -> int:
    """How far M, D, K had to go, in steps that matter: all that tells a dead zone from a stop, or a spring from its lack."""
    return int(9 * one.moved / CLOSE)  # as in the price of a fit by free-run simulation


def look(problem: ForceProblem, base: Fit, catalogue, rules: Rules) -> Round:
    """One screen and its finalists."""
    screened = screen_on_force(problem, base, catalogue)
    R = len(base.rows)
    if not screened.candidates or screened.candidates[0].explained < 30 + 4 * np.log(R):
        return Round(screened, [], base, None)
    contenders = by_batches(problem, base, screened, rules, partial(_fitted, problem, base))
    contenders.sort(key=lambda c: c.cost)
    return Round(screened, contenders, base, _simplest(problem, contenders, rules))


def _simplest(problem: ForceProblem, contenders: list[Contender], rules: Rules) -> Contender | None:
    """On the force: the fewest parameters, and a name before none, of those that held-out blocks find as good."""
    if not contenders:
        return None
    losses = [block_losses(problem, c.fit) for c in contenders]
    best = contenders[int(np.argmin([x.sum() for x in losses]))]
    related = [subset(c.effect, best.effect) for c in contenders]
    ranks = [(*_rank(c.fit, c.effect), _moves(c.fit)) for c in contenders]
    force = force_of(problem, best.fit)
    return contenders[simplest(losses, ranks, related, (rules.second_share, rules.practical), force)]


def _fitted(
    problem: ForceProblem, base: Fit, tried: list[Candidate], before: list[Contender]
) -> list[Contender]:
    found: list[Contender] = []
    for candidate in tried:
        clean = any(c.fit.rho < 1.1 and not c.is_decoy for c in (*before, *found))
        if clean and candidate.explained < 0.9 * tried[0].explained:
            continue  # something closes the gap already, and this one is far behind
        one = refine(problem, base, candidate)
        if one is not None:
            found.append(one)
    return found


def _told(problem: ForceProblem, story: Story, first: Round, catalogue, rules: Rules) -> Story:
    """The story that follows from a first look: every later effect must earn its place."""
    for k in range(rules.most_on_force):
        if story.fit.rho < rules.enough and k > 0:
            break
        round_ = first if k == 0 else look(problem, story.fit, catalogue, rules)
        chosen = round_.chosen
        if chosen is not None and chosen.is_decoy and k > 0:
            # on a machine some shape always fits what is left a little; the names that earn their place come first
            chosen = _simplest(problem, [c for c in round_.contenders if not c.is_decoy], rules)
        if chosen is not None and not earns_on_force(problem, story.fit, chosen.fit, rules.practical):
            chosen = None
        story.rounds.append(replace(round_, chosen=chosen))
        if chosen is None:
            break
        story.fit = chosen.fit
        if chosen.is_decoy:
            break
        if k > 0:
            cost, others = partial(held_out_cost, problem), partial(_others, problem, catalogue)
            story.fit = reconsidered(problem, story.fit, cost, 2 * rules.practical, others)
            story.fit = pruned(
                problem,
                story.fit,
                lambda without, now: not earns_on_force(problem, without, now, rules.practical),
            )
    return story


def _others(
    problem: ForceProblem, catalogue, without: Fit | None, now: Fit, effect: Effect
) -> Iterator[Contender]:
    """What may stand in the place of an effect: nothing richer, for on a machine a richer shape always gains a little."""
    if without is None:
        return
    rank = _rank(now, effect)
    for candidate in shortlist(screen_on_force(problem, without, catalogue), 4):
        if not is_it(candidate, effect):
            other = refine(problem, without, candidate, iterations=8)
            if other is not None and _rank(other.fit, other.effect) <= rank:
                yield other
