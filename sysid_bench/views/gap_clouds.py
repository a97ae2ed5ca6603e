"""answer of the gap workflow -> the force that the linear part leaves, over displacement and velocity."""

from __future__ import annotations

from typing import Any

import numpy as np

from sysid_bench.gap.answer import Answer
from sysid_bench.gap.motion import force_along, smoothed
from sysid_bench.mechanics.effect import direction
from sysid_bench.nouns import Array
from sysid_bench.views.gap_words import place_words
from sysid_bench.views.svg import Axes, field

CLOUD = 1500
Figure = tuple[str, str, str]  # SVG, what it is, caption


def found_forces(answer: Answer) -> list[Any]:
    """The forces that were found, without those that the model had."""
    found = answer.story.fit.point.effects[len(answer.problem.model.effects) :]
    return [effect for effect in found if effect.path == "force"]


def unexplained(answer: Answer, effect: Any) -> tuple[Array, Array, Array]:
    """x, v, force (N,) at an effect's place on the first training record: what the better model without it leaves."""
    problem, fit = answer.problem, answer.story.fit
    c = direction(effect.dof, problem.model.n)
    trace, run = problem.traces[0], fit.runs[0]
    q, v, a = smoothed(problem, trace, run)
    M, D, K = problem.matrices(fit.point.theta)
    force = trace.u @ problem.model.input_map.T - a @ M.T - v @ D.T - q @ K.T
    for other in fit.point.effects:
        if other.path == "force" and other is not effect:
            o = direction(other.dof, problem.model.n)
            force = force - np.outer(force_along(other, q @ o, v @ o, trace.h, trace.t0), o)
    ends = c != 0
    return q @ c, v @ c, force[:, ends] @ (c[ends] / np.sum(ends))


def clouds(answer: Answer) -> list[Figure]:
    """Per force found: what the rest leaves, and the law on it; at each place once: the same over the state."""
    figures, places = [], set()
    for effect in found_forces(answer):
        x, v, force = unexplained(answer, effect)
        figures.append(_law(answer, effect, x, v, force))
        if str(effect.dof) not in places:
            figures.append(_over_state(place_words(effect.dof), x, v, force))
        places.add(str(effect.dof))
    return figures


def _law(answer: Answer, effect: Any, x: Array, v: Array, force: Array) -> Figure:
    trace = answer.problem.traces[0]
    fitted = force_along(effect, x, v, trace.h, trace.t0)
    shown = slice(None, None, max(1, len(x) // CLOUD))
    by_speed = _follows(fitted, v) > _follows(fitted, x)
    against, label = (v, "relative velocity (m/s)") if by_speed else (x, "relative displacement (m)")
    axes = Axes((float(against.min()), float(against.max())), inner(force, fitted), label, "force (N)")
    axes.dots(against[shown], force[shown], 7)
    axes.dots(against[shown], fitted[shown], 1)
    axes.legend([("left by the rest", 7), (effect.name, 1)])
    caption = f"Force at {place_words(effect.dof)} that the rest of the better model leaves, and {effect.name} as fitted."
    return axes.text(), f"{effect.name} on the residual cloud", caption


def _over_state(where: str, x: Array, v: Array, force: Array) -> Figure:
    picture = field(x, v, force, "displacement (m)", "velocity (m/s)")
    caption = (
        f"The same force at {where} over displacement and velocity: "
        "orange positive, blue with a dash negative, pale small."
    )
    return picture, "force over state", caption


def _follows(f: Array, z: Array) -> float:
    """How smoothly the force runs along z; larger is smoother."""
    return -float(np.mean(np.diff(f[np.argsort(z)]) ** 2))


def inner(*parts: Array) -> tuple[float, float]:
    """Range of all but the outermost per cent, with room for a legend above."""
    low, high = np.percentile(np.concatenate(parts), [0.5, 99.5])
    return float(low), float(high + 0.25 * (high - low))
