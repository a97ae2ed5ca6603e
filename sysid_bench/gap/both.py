"""pairs of a screen -> two effects fitted at once, by simulation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sysid_bench.gap.candidates import Candidate, Screen
from sysid_bench.gap.contend import Arena, kindred, refine
from sysid_bench.gap.descent import Fit
from sysid_bench.gap.finalists import shortlist
from sysid_bench.gap.look import finalists, fits_of, from_the_nominal
from sysid_bench.gap.nudge import leads
from sysid_bench.gap.pairs import Pair
from sysid_bench.gap.price import Contender, cheapest
from sysid_bench.gap.problem import Problem
from sysid_bench.gap.story import Round, Rules

NEAR = 1.5  # times the best pair's rho: other frictions are tried in place of one in such a pair
LIKE = 1.2  # times what a pair leaves that closes the gap: the screen does not tell them apart
NEGLIGIBLE = 1e-3  # share of the linear gap below which nothing further is looked for
CLEAN = 1.2  # rho at which an explanation is complete
SHUT = 1.1  # rho at which pairs are taken before anything is led
APART = 0.5  # of the noise: where the best suspect leaves less beyond it, nothing is left for a second one
PROMISED = 0.25  # of what the best suspect leaves beyond the noise: pairs that leave less are tried first


def promising(screened: Screen, found: Callable[[], list[Pair]]) -> list[Pair]:
    """Pairs, best first, that leave far less than any single suspect, named or not, along the motion that was measured."""
    if not screened.candidates:
        return []
    alone = screened.promise(max(c.explained for c in screened.candidates)) - 1
    if alone < APART:
        return []
    return [p for p in found() if screened.promise(p.polished.explained) - 1 < PROMISED * alone]


def glance(problem: Problem, base: Fit, screened: Screen, rules: Rules) -> Round:
    """The first finalists of a screen, each fitted straight from where it starts, the leader from the nominal too; none is chosen."""
    arena = Arena(problem, base, leads(problem, screened.seens), closed=base.rho < 1.1, straight=True)
    contenders = fits_of(arena, screened, shortlist(screened, finalists(problem, rules)), [])
    contenders += from_the_nominal(arena, contenders)
    return Round(screened, sorted(contenders, key=lambda c: c.cost), base, None)


def both(
    problem: Problem,
    linear: Fit,
    base: Fit,
    screened: Screen,
    found: list[Pair],
    rules: Rules,
    straight: bool = False,
) -> Round | None:
    """A second look that takes two effects at once; None where no pair closes the gap.

    base: the fit of one effect; found: pairs of the screen, best first; straight: none of them is led
    """
    linear_gap = max(linear.rss - len(linear.rows), 1.0)
    arena = Arena(problem, linear, leads(problem, screened.seens), straight=straight)
    contenders: list[Contender] = []
    closing = np.inf  # energy that the screen leaves of a pair that closes the gap
    for pair in found:
        remains = screened.left - pair.polished.explained
        if remains > LIKE * closing:
            continue
        candidate = Candidate(
            pair.effects[1], pair.polished.explained, pair.score, np.zeros(0), pair.polished.theta, False
        )
        one = refine(arena, candidate, screened.promise(candidate.explained), pair.effects[:1], 15)
        if one is not None:
            contenders.append(one)
            if one.fit.rho < rules.enough:
                closing = min(closing, remains)
    nearest = min((c.fit.rho for c in contenders), default=1.0)
    known: set = set()  # frictions that were tried in the place of another, where the gap is closed
    for one in [c for c in contenders if c.fit.rho < NEAR * nearest]:
        kin = kindred(arena, one, known)
        known |= {(c.effect.name, c.effect.dof) for c in kin if nearest < SHUT}
        contenders += kin
    contenders.sort(key=lambda c: c.cost)
    best = cheapest(contenders, linear_gap, rules.practical)
    tolerated = SHUT if straight else max(CLEAN, 1 + NEGLIGIBLE * (linear.rho - 1))
    if best is None or best.fit.rho > tolerated:
        return None
    return Round(screened, contenders, base, best)
