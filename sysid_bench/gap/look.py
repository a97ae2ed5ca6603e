"""problem, where it is looked at from -> a round: the screen, its finalists fitted by simulation, the cheapest one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from sysid_bench.gap.candidates import Candidate, Screen
from sysid_bench.gap.contend import Arena, kindred, refine
from sysid_bench.gap.descent import Fit, fit
from sysid_bench.gap.finalists import shortlist
from sysid_bench.gap.grounds import bend, ground_of, view
from sysid_bench.gap.nudge import leads
from sysid_bench.gap.price import CLOSED, Contender, cheapest, noticeable
from sysid_bench.gap.problem import Problem
from sysid_bench.gap.story import Round, Rules

UNCLEAN = 0.05  # share of the linear gap above which an unnamed shape has not explained it
BATCHES = 3  # of finalists, where the screen promises what no fit keeps
# Times what the best suspect leaves, from which others are not fitted once something closes the gap.
FAR = 1.6
HARDLY = 0.5  # of what is left: where every suspect leaves more, the screen was misled
STRAYED = 0.2  # step in priors from which a fit may have been led astray by where it began


def look(
    problem: Problem,
    base: Fit,
    catalogue,
    rules: Rules,
    linear_gap: float,
    screened: Screen | None = None,
    known: list[Contender] | None = None,
    begun: list[Contender] | None = None,
) -> Round:
    """One screen and its finalists.

    screened: what they are taken from; known, begun: contenders of an earlier look, of a glance from base
    """
    screened = screened or view(problem, ground_of(problem, base), catalogue)
    R = len(base.rows)
    if not screened.candidates or screened.candidates[0].explained < noticeable(R):
        return Round(screened, [], base, None)
    small = problem.model.n < 6
    arena = Arena(
        problem,
        base,
        leads(problem, screened.seens),
        closed=base.rho < 1.1,
        leads_left=5 if small else 3,
        known=known or [],
        begun=begun or [],
    )
    contenders = by_batches(problem, base, screened, rules, partial(fits_of, arena, screened))
    contenders += _frictions(arena, screened, contenders)
    contenders += _stops(arena, screened, contenders)
    contenders += from_the_nominal(arena, contenders)
    contenders = _with_kin(arena, contenders)
    return Round(screened, contenders, base, cheapest(contenders, linear_gap, rules.practical))


def by_batches(
    problem: Problem,
    base: Fit,
    screened: Screen,
    rules: Rules,
    fitted: Callable[[list[Candidate], list[Contender]], list[Contender]],
) -> list[Contender]:
    """What `fitted` makes of the best suspects, beside those before: batch after batch until some fit keeps its promise."""
    contenders: list[Contender] = []
    rest = screened
    for _ in range(BATCHES):
        tried = shortlist(rest, finalists(problem, rules))
        contenders += fitted(tried, contenders)
        if not tried or as_promised(base, contenders, screened):
            break
        names = {c.effect.name for c in tried}
        rest = replace(rest, candidates=[c for c in rest.candidates if c.effect.name not in names])
    return contenders


def from_the_nominal(arena: Arena, contenders: list[Contender]) -> list[Contender]:
    """The name that leads, fitted once more from the nominal where it bent M, D, K and still leaves something.

    From a refit that has swallowed part of it, its descent creeps along a valley.
    """
    best = min((c for c in contenders if not c.is_decoy), key=lambda c: c.cost, default=None)
    if best is None or best.fit.rho < CLOSED or bend(arena.problem, best.fit) < STRAYED:
        return []
    at = best.fit.point
    start = replace(at, theta=np.zeros_like(at.theta), starts=arena.problem.begins)
    found = fit(arena.problem, start, best.fit.parameters, enough=best.fit.rss)
    return [arena.contender(found, best.candidate)] if found is not None and found.rss < best.fit.rss else []


def finalists(problem: Problem, rules: Rules) -> int:
    """How many suspects are fitted by simulation at a time."""
    return rules.finalists if problem.model.n < 6 else max(3, rules.finalists - 3)


def _with_kin(arena: Arena, contenders: list[Contender]) -> list[Contender]:
    """Contenders, cheapest first, with the laws near to that which leads."""
    contenders = sorted(contenders, key=lambda c: c.cost)
    named = next((c for c in contenders if not c.is_decoy), None)
    if named is None:
        return contenders
    near = {(c.effect.name, c.effect.dof) for c in contenders if c.fit.rho < 1.3 * named.fit.rho}
    return sorted([*contenders, *kindred(arena, named, near)], key=lambda c: c.cost)


def _frictions(arena: Arena, screened: Screen, contenders: list[Contender]) -> list[Contender]:
    """Coulomb friction where the best contender acts, and at the best place, while something is left.

    A screen along a noisy motion sees little of a friction that sticks.
    """
    if not contenders or min(c.fit.rho for c in contenders) < CLOSED:
        return []
    best = min(contenders, key=lambda c: c.cost)
    places = {best.effect.dof, max(screened.by_place, key=lambda place: screened.by_place[place])}
    tried = {c.effect.dof for c in contenders if c.effect.name == "coulomb_friction"}
    out = []
    for c in screened.candidates:
        if c.effect.name == "coulomb_friction" and c.place in places - tried:
            one = refine(arena, c, screened.promise(c.explained))
            out += [one] if one is not None else []
    return out


def _stops(arena: Arena, screened: Screen, contenders: list[Contender]) -> list[Contender]:
    """End stops at the best place, to either side and both, where no suspect keeps half of what is left.

    The smoothed motion does not show how far a hard stop gives way: its force along it is a poor likeness.
    """
    base = arena.base
    least = min((c.fit.rho for c in contenders), default=base.rho)
    if least < CLOSED or least - 1 < HARDLY * (base.rho - 1):
        return []
    best = max(screened.by_place, key=lambda place: screened.by_place[place])
    found: dict[float, Candidate] = {}
    for c in screened.candidates:
        if c.effect.name == "end_stop" and c.place == best:
            found.setdefault(float(c.effect.values[-1]), c)  # by side
    fits = [refine(arena, c, screened.promise(c.explained)) for c in found.values()]
    return [one for one in fits if one is not None]


def fits_of(
    arena: Arena, screened: Screen, tried: list[Candidate], before: list[Contender]
) -> list[Contender]:
    found: list[Contender] = []
    for candidate in tried:
        clean = any(c.fit.rho < 1.1 and not c.is_decoy for c in (*before, *found))
        if clean and (far(screened, candidate, tried[0]) or candidate.explained < 0.9 * tried[0].explained):
            continue  # something closes the gap already, and this one is far behind
        one = refine(arena, candidate, screened.promise(candidate.explained))
        if one is not None:
            found.append(one)
    return found


def far(screened: Screen, candidate: Candidate, best: Candidate) -> bool:
    """True for what is not fitted once something closes the gap: the screen leaves far more of it than of the best."""
    # a delay and a lag are told apart by their fits alone
    left = screened.left
    return candidate.effect.path != "actuator" and left - candidate.explained > FAR * (left - best.explained)


def as_promised(base: Fit, contenders: list[Contender], screened: Screen) -> bool:
    """True where some fit keeps half of what its screen promised; else the screen was misled and the next are tried."""
    left = max(base.rss - len(base.rows), 1.0)
    share = [(base.rss - c.fit.rss) / left for c in contenders]
    promised = [min(c.candidate.explained / max(screened.left, 1e-9), 1.0) for c in contenders]
    return any(s > 0.5 * p for s, p in zip(share, promised))


def first_look(
    problem: Problem,
    linear: Fit,
    catalogue,
    rules: Rules,
    linear_gap: float,
    views: Iterator[Screen],
    begun: list[Contender] | None = None,
) -> Round:
    """The first look, from one view after the other until a name leaves little. begun: as in look, of the first view."""
    best = look(problem, linear, catalogue, rules, linear_gap, next(views), begun=begun)
    known = [*best.contenders]
    while not _shut(best, linear) and (screened := next(views, None)) is not None:
        other = look(problem, linear, catalogue, rules, linear_gap, screened, known)
        known += other.contenders
        best = _cheaper(best, other)
    return best


def _shut(one: Round, linear: Fit) -> bool:
    """True where a name leaves next to nothing."""
    chosen = one.chosen
    return chosen is not None and not chosen.is_decoy and chosen.fit.rho - 1 < UNCLEAN * (linear.rho - 1)


def _cheaper(one: Round, other: Round) -> Round:
    """The look whose choice costs less."""
    if other.chosen is None:
        return one
    return other if one.chosen is None or other.chosen.cost < one.chosen.cost else one
