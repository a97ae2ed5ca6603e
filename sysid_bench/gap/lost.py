"""a search that lost the motion -> the story told where no free run must follow it: held near it, or in pieces.

Clearance, ripple and friction that sticks may make a motion chaotic: the true law's own free run leaves it. Held near
the motion that was measured (`nudge`) or begun anew every few periods (`pieces`), a simulation still tells laws apart.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from sysid_bench.gap.decide import Verdict
from sysid_bench.gap.descent import Fit, fit, free_parameters
from sysid_bench.gap.motion import Seen, seen
from sysid_bench.gap.nudge import held_near
from sysid_bench.gap.pieces import closes, in_pieces
from sysid_bench.gap.problem import Budget, Problem, budget_of
from sysid_bench.gap.refit import linear_fit
from sysid_bench.gap.rounding import for_any_rounding
from sysid_bench.gap.story import Story

STEPS = 6  # of the fit without hold, from what was found under it
SHARE_OF_BUDGET = 0.3  # of what the search on whole records has
FEWEST = 3  # DOFs that it is reckoned for at least
LEFT, FLOORS = 0.01, 2.0  # share of the linear gap, and rho, above which named effects have lost the motion
# Of the gap, that the first effect must take: else what is missing is no law that loses the motion.
FIRST = 0.5


def lost(word: str, fit: Fit, linear: Fit) -> bool:
    """True where a verdict may be so because no free run follows the motion: nothing is named, or names leave much."""
    if word == "unknown":
        return not closes(fit, linear)
    return fit.rho > FLOORS and fit.rho - 1 > LEFT * (linear.rho - 1)


def told_anew(
    problem: Problem,
    whole: Fit,
    choose: Callable[[Problem, Fit], Story],
    judge: Callable[[Problem, Story], Verdict],
    tell: Callable[[str], object],
) -> tuple[Problem, Story, Verdict] | None:
    """The story told near the motion, or in pieces where not all of that is measured; None where it names nothing.

    choose: problem, its refit -> the story of the effects; judge: problem, story -> the verdict
    """
    parted, near = in_pieces(problem, whole), held_near(problem, _seens(problem, whole))
    other = near or parted
    if other is None:
        return None
    other = replace(other, budget=_budget(other))
    # what bends M, D, K hides what is missing: held, the nominal itself is where to look from
    linear = fit(other, other.nominal(), free_parameters(other.effects), 0) if near else linear_fit(other)
    if linear is None:
        return None
    how = "held near it" if near else f"looked at in {len(other.traces)} pieces"
    tell(f"no free run found that follows the motion: {how}")
    story = choose(other, linear)
    verdict = judge(other, story)
    if verdict.word != "effect" or lost(verdict.word, story.fit, linear):
        return None
    for one in (problem, parted) if near else ():
        freed = _freed(one, whole, story) if one is not None else None
        if one is not None and freed is not None:
            return one, freed, judge(one, freed)
    return problem if near else other, story, verdict


def _seens(problem: Problem, whole: Fit) -> list[Seen]:
    """The smoothed motion of every trace."""
    return [seen(problem, whole.point, *each) for each in zip(problem.traces, whole.runs, whole.point.starts)]


def _budget(problem: Problem) -> Budget:
    """Of the story told anew."""
    samples = sum(one.N for one in problem.traces)
    return Budget(SHARE_OF_BUDGET * budget_of(max(problem.model.n, FEWEST), samples).left)


def _freed(problem: Problem, linear: Fit, story: Story) -> Story | None:
    """The story with its effects fitted where nothing holds the simulation; None where they do not close the gap there."""
    point = replace(story.fit.point, starts=problem.begins)
    found = fit(replace(problem, budget=Budget()), point, story.fit.parameters, STEPS)
    if found is None or not closes(found, linear):
        return None
    return Story(linear, for_any_rounding(problem, found), story.rounds)
