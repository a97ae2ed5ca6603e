"""linear fit, catalogue -> the effects that are missing, one after the other, and what nearly won.

Screen, polish, fit the best few by free-run simulation jointly with M, D, K, keep the cheapest explanation. Where one
name does not close the gap, pairs are tried together, then another look beside what was found. A later effect must
earn its place; what became unnecessary is dropped.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import chain

import numpy as np

from sysid_bench.gap.again import is_it, pruned, reconsidered
from sysid_bench.gap.both import NEGLIGIBLE, SHUT, both, glance, promising
from sysid_bench.gap.candidates import Candidate, Screen
from sysid_bench.gap.contend import Arena, best_start, refine
from sysid_bench.gap.descent import Fit, fit, free_parameters
from sysid_bench.gap.finalists import FRICTION, polished_screen, relatives, shortlist
from sysid_bench.gap.fineness import on_finer_steps
from sysid_bench.gap.grounds import first_views
from sysid_bench.gap.look import UNCLEAN, far, first_look, look
from sysid_bench.gap.nudge import leads
from sysid_bench.gap.pairs import pairs
from sysid_bench.gap.pieces import closes
from sysid_bench.gap.price import Contender, noticeable, price, subset
from sysid_bench.gap.problem import Problem
from sysid_bench.gap.rounding import for_any_rounding
from sysid_bench.gap.screen import screen
from sysid_bench.gap.story import Round, Rules, Story
from sysid_bench.mechanics.effect import Effect

PAIRS = 3  # fitted by simulation
KEPT = 0.4  # of the budget, for pairs and later effects
NEARLY_ALL = 0.01  # share of the linear gap below which a story told otherwise is believed
SEEN = 1.5  # rho from which even such a share is looked into, beside a single effect
ZERO_OFF = ("sensor_bias", "sensor_drift")
ZERO_OFF_TAKES = 0.1  # of what a refit leaves, from which they are tried first


def earns(problem: Problem, before: Fit, after: Fit, linear: Fit, first: bool, rules: Rules) -> bool:
    """True where an effect takes enough of what is left."""
    R = len(before.rows)
    gain, left, linear_gap = before.rss - after.rss, before.rss - R, max(linear.rss - R, 1.0)
    if gain < 25:
        return False
    if first:
        return gain > max(noticeable(R), rules.first_share * left)
    clean = closes(after, linear) and gain > 0.7 * left and gain > 5 * np.sqrt(2 * R)
    clean = clean and not _reshapes(after.point.effects)
    return gain > rules.second_share * max(left, 0) and (gain > rules.practical * linear_gap or clean)


def _reshapes(effects: tuple[Effect, ...]) -> bool:
    """True where the last is a friction beside another one at its place: by little, it only mends the shape of the first's law."""
    *earlier, last = effects
    return last.name in FRICTION and any(e.name in FRICTION and e.dof == last.dof for e in earlier)


def choose(problem: Problem, linear: Fit, catalogue: list[type[Effect]], rules: Rules | None = None) -> Story:
    """The story of the missing effects. Pure: nothing but its arguments decides."""
    rules = rules or Rules()
    linear_gap = max(linear.rss - len(linear.rows), 1.0)
    views = first_views(problem, linear, catalogue)
    screened = next(views)
    story, begun = _at_once(problem, linear, screened, catalogue, rules)
    if story is not None:
        return story
    problem.budget.keep(KEPT)
    first = first_look(problem, linear, catalogue, rules, linear_gap, chain([screened], views), begun)
    problem.budget.keep(0.0)
    story = _told(problem, Story(linear, linear), first, catalogue, rules)
    much = story.fit.rss - len(story.fit.rows) >= UNCLEAN * linear_gap
    if not much and not story.ends_unnamed:
        return story
    for round_ in _other_firsts(problem, first):
        other = _told(problem, Story(linear, linear), round_, catalogue, rules)
        enough = closes(other.fit, linear) or (much and other.fit.rho - 1 < NEARLY_ALL * (linear.rho - 1))
        if enough and not other.ends_unnamed:
            return other
    return story


def _other_firsts(problem: Problem, first: Round) -> Iterator[Round]:
    """What else may come first where the cheapest leads to no explanation."""
    shape = first.chosen
    if shape is not None and shape.is_decoy and not closes(shape.fit, first.before):
        # No single force closes the gap: an unnamed shape may stand for the sum of two named ones.
        yield from [replace(first, chosen=c) for c in first.contenders if not c.is_decoy][:1]
    if shape is not None and shape.effect.name in ZERO_OFF:
        return
    # A sensor whose zero is off shows a motion that was not: along it no force is what it is.
    arena = Arena(problem, first.before)
    for c in first.screen.candidates:
        if c.effect.name in ZERO_OFF and c.explained > ZERO_OFF_TAKES * first.screen.left:
            one = refine(arena, c, first.screen.promise(c.explained))
            if one is not None:
                yield replace(first, contenders=[one], chosen=one)
            return


def _at_once(
    problem: Problem, linear: Fit, screened: Screen, catalogue, rules: Rules
) -> tuple[Story | None, list[Contender]]:
    """The story of two effects that close the gap where none does alone, and the single fits on the way to it.

    None where there are no such two.
    """
    found = promising(screened, partial(pairs, problem, screened, PAIRS))
    if not found:
        return None, []
    first = glance(problem, linear, screened, rules)
    named = next((c for c in first.contenders if not c.is_decoy), None)
    if named is None or closes(first.contenders[0].fit, linear):
        return None, first.contenders
    second = both(problem, linear, named.fit, screened, found, rules, straight=True)
    if second is None or not earns(problem, linear, named.fit, linear, True, rules):
        return None, first.contenders
    story = _told(problem, Story(linear, linear), replace(first, chosen=named), catalogue, rules, second)
    return (story if story.fit.rho < SHUT else None), first.contenders


def _told(
    problem: Problem, story: Story, first: Round, catalogue, rules: Rules, second: Round | None = None
) -> Story:
    """The story that follows from a first look: every later effect must earn its place. second: a later look that is known."""
    linear, R = story.linear, len(story.linear.rows)
    linear_gap = max(linear.rss - R, 1.0)
    for k in range(rules.most):
        if k > 0 and (_closed(story.fit, linear, k, rules) or problem.budget.spent):
            break
        if k == 0:
            round_ = first
        elif k == 1 and (later := second or _both(problem, story, first, rules)) is not None:
            round_ = later
        else:
            round_ = look(problem, story.fit, catalogue, rules, linear_gap)
        chosen = round_.chosen
        if chosen is not None and not earns(problem, story.fit, chosen.fit, linear, k == 0, rules):
            chosen = None
        story.rounds.append(replace(round_, chosen=chosen))
        if chosen is None:
            break
        story.fit = chosen.fit
        if chosen.is_decoy:
            break
        problem, story.fit = on_finer_steps(problem, story.fit)
        if k > 0:
            others = partial(_others, problem, catalogue)
            story.fit = reconsidered(problem, story.fit, partial(price, problem), 0.1, others)
            story.fit = pruned(problem, story.fit, _needless)
    story.fit = for_any_rounding(problem, story.fit)
    return story


def _both(problem: Problem, story: Story, first: Round, rules: Rules) -> Round | None:
    """The best pairs of the first look's screen, fitted."""
    found = pairs(problem, first.screen, PAIRS)
    return both(problem, story.linear, story.fit, first.screen, found, rules)


def _closed(now: Fit, linear: Fit, found: int, rules: Rules) -> bool:
    """True where nothing further is looked for beside so many found effects.

    Beside one alone a small share of a large gap may still be a second effect, which then must close it.
    """
    seen = SEEN if found == 1 else np.inf
    return now.rho - 1 < max(rules.enough - 1, min(NEGLIGIBLE * (linear.rho - 1), seen - 1))


def _others(
    problem: Problem, catalogue, without: Fit | None, now: Fit, effect: Effect
) -> Iterator[Contender]:
    """What may stand in the place of an effect. What closes the gap is renamed only by a name whose own descent finds as much."""
    yield from _simpler(problem, now, effect)
    if without is None:
        return
    screened = screen(problem, without, catalogue)
    closed = now.rho < 1.1
    arena = Arena(problem, without, leads(problem, screened.seens), closed=closed, least=now.rss)
    tried = shortlist(polished_screen(problem, screened), 4)
    for candidate in tried:
        if not is_it(candidate, effect) and not (closed and far(screened, candidate, tried[0])):
            other = refine(arena, candidate, screened.promise(candidate.explained), iterations=8)
            if other is not None:
                yield other


def _needless(without: Fit, now: Fit) -> bool:
    return without.rss - now.rss < max(25, 0.3 * max(now.rss - len(now.rows), 0))


def _simpler(problem: Problem, now: Fit, effect: Effect) -> Iterator[Contender]:
    """Simpler laws in the place of a friction or a stop: it was named while the later effects were not known."""
    rest = tuple(x for x in now.point.effects if x is not effect)
    for starts in relatives(problem, now, effect).values():
        choices = [replace(now.point, effects=(*rest, one)) for one in starts if subset(one, effect)]
        start = best_start(problem, choices)
        found = fit(problem, start[1], free_parameters(start[1].effects), 12) if start is not None else None
        if found is not None:
            as_it_is = Candidate(found.point.effects[-1], 0.0, 0.0, np.zeros(0), found.point.theta, False)
            yield Contender(found, as_it_is, price(problem, found))
