"""story -> verdict: effect, parameters, none or unknown, with the reason in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid_bench.gap.descent import Fit
from sysid_bench.gap.grounds import bend
from sysid_bench.gap.held_out import PRACTICAL
from sysid_bench.gap.inverse import ForceProblem
from sysid_bench.gap.moves import closed_nearby, moved_knobs, practical_moves
from sysid_bench.gap.price import DECOY_NAMES
from sysid_bench.gap.problem import Problem
from sysid_bench.gap.story import Story
from sysid_bench.gap.thresholds import Thresholds

# Step of an entry, in priors, and times that of the refit, from which named effects are no explanation.
BENT, BENT_BESIDE = 2.0, 2.0


@dataclass(frozen=True)
class Verdict:
    """word: effect, parameters, none or unknown; reason: one sentence."""

    word: str
    reason: str


def decide(
    problem: Problem, story: Story, nominal_rho: float, faults: int, thresholds: Thresholds
) -> Verdict:
    """The verdict from the training records alone."""
    now, base = story.fit, len(problem.model.effects)
    found = now.point.effects[base:]
    left = (now.rho - 1) / max(story.linear.rho - 1, 1e-9)
    for effect in found:
        if effect.name in DECOY_NAMES:
            return Verdict(
                "unknown",
                f"{effect.name} at {place_words(effect.dof)} explains it best; no catalogue effect does",
            )
    if found and _too_much(now.rho, left, problem.on_force, thresholds):
        names = ", ".join(e.name for e in found)
        return Verdict(
            "unknown", f"{names} leaves {100 * left:.0f} % of the gap, {now.rho:.1f} times the noise floor"
        )
    if found and _bent(problem, story):
        names = ", ".join(e.name for e in found)
        return Verdict(
            "unknown",
            f"{names} explain it only beside M, D, K far from the nominal, where they alone would not go",
        )
    if found and isinstance(problem, ForceProblem):
        before, after = (100 * problem.share_missed(fit) for fit in (story.linear, now))
        return Verdict(
            "effect",
            f"the gap on the force falls from {before:.3g} % to {after:.3g} %; what is left has no name and is "
            f"{np.sqrt(now.rho):.3g} times the noise floor",
        )
    if found or faults:
        first = problem.traces[0]
        told = f"the gap falls from {story.linear.rho:.3g} to {now.rho:.3g} times the noise floor"
        if first.part_of is not None:
            told += f" in pieces of {first.N * first.h:.3g} s; on whole records no search found a free run that follows"
        if problem.held:
            told += " held near the measured motion by springs and dampers; no search found a free run that follows"
        return Verdict("effect", told)
    if now.rho > thresholds.bare_rho and not _small(problem, now):
        return Verdict(
            "unknown", f"{now.rho:.1f} times the noise floor is left, and no catalogue effect explains it"
        )
    moved = practical_moves(problem, now, thresholds) or moved_knobs(problem, now, thresholds)
    worse = nominal_rho > thresholds.moved_rho * max(now.rho, 1)
    if worse and (moved or not closed_nearby(problem, now, thresholds)):
        return Verdict(
            "parameters",
            f"other parameters close the gap from {nominal_rho:.3g} to {now.rho:.3g} times the noise floor",
        )
    return Verdict(
        "none",
        f"the model leaves {now.rho:.3g} times the noise floor: nothing is missing that these records can show",
    )


def _too_much(rho: float, left: float, on_force: bool, thresholds: Thresholds) -> bool:
    """True where named effects leave too much of the gap to be what is missing."""
    if on_force:
        return rho > thresholds.left_rho and left > thresholds.left_on_force
    most = rho > thresholds.left_rho and left > thresholds.left_share
    return most or (rho > thresholds.part_rho and left > thresholds.part_share)


def _bent(problem: Problem, story: Story) -> bool:
    """True where the effects named bend M, D, K much farther than a refit without them: shapes that only help to follow it."""
    if problem.on_force:
        return False
    if problem.held:  # of damping nothing is said: a friction trades with it
        far = np.abs(story.fit.point.theta / problem.prior) >= problem.reach
        return any(end and m != 1 for end, (m, _, _) in zip(far, problem.entries))
    return bend(problem, story.fit) > max(BENT, BENT_BESIDE * bend(problem, story.linear))


def _small(problem: Problem, now: Fit) -> bool:
    """True where the force is judged and what is left of it matters on no machine."""
    return isinstance(problem, ForceProblem) and problem.share_missed(now) < PRACTICAL


def place_words(dof) -> str:
    """DOF 0, or DOFs 0 and 1."""
    return f"DOFs {dof[0]} and {dof[1]}" if isinstance(dof, tuple) else f"DOF {dof}"


def place_value(dof) -> Any:
    """A place as JSON has it: a number, a pair as a list, null."""
    return list(dof) if isinstance(dof, tuple) else dof
