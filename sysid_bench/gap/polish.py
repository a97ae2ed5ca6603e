"""suspects with shapes off a grid -> the same with shapes fitted: no simulation, along the motion that really was.

Along the true motion a suspect's force is exact whatever M, D, K are, so its parameters are found by a small
Gauss-Newton descent on the screen's own least squares (variable projection; Golub, Pereyra 1973). It brings the later
fit by simulation into the right valley, and several suspects may be polished together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sysid_bench.gap.basis import thin
from sysid_bench.gap.candidates import Candidate, Screen
from sysid_bench.gap.columns import actuated_difference, force_columns, mode_column
from sysid_bench.gap.descent import free_parameters
from sysid_bench.gap.motion import Seen
from sysid_bench.gap.place_forces import forces_along
from sysid_bench.gap.problem import Point, Problem
from sysid_bench.mechanics.assembly import effect_channels
from sysid_bench.mechanics.effect import POSITIVE, Effect, direction
from sysid_bench.nouns import Array

LONGEST_STEP = 0.7  # of a logarithm
DRIVEN = (
    0.3  # of the input that must arrive: a drive that passes less moves nothing, and no record is taken so
)


@dataclass(frozen=True, eq=False)
class Polished:
    """effects with fitted parameters, the energy that they explain together, theta that goes with them."""

    effects: tuple[Effect, ...]
    explained: float
    theta: Array


def polishable(effect: Effect) -> bool:
    """True where the response to the effect along a known motion depends on its parameters in a curved way."""
    return effect.path in ("force", "actuator") or effect.name == "extra_mode"


def drives(problem: Problem, effects: tuple[Effect, ...]) -> bool:
    """True where the input still arrives after the actuator effects.

    Where a motion is far from linear, taking the input away altogether explains most of what a linear model misses.
    """
    L, trace = problem.model.input_map, problem.traces[0]
    for effect in effects:
        if effect.path == "actuator":
            channels, stages = effect_channels(effect, L), trace.stages(1)
            arrived, _ = effect.act(stages, trace.h, channels, None)
            if arrived[:, :, channels].std() < DRIVEN * stages[:, :, channels].std():
                return False
    return True


def polish(
    problem: Problem, screened: Screen, effects: tuple[Effect, ...], iterations: int = 5
) -> Polished | None:
    """Fit the parameters of some effects together. None where their forces are not finite."""
    (b, _), free = screened.ground, free_parameters(effects)
    now = rows_of(problem, screened, effects, ())
    if now is None:
        return None
    left = b.r - now[:, 0]
    cost, damping = float(left @ left), 1e-3
    for _ in range(iterations):
        F = rows_of(problem, screened, effects, free)
        if F is None:
            break
        J = F[:, 1:]
        H, g = J.T @ J, J.T @ left
        size = np.diag(H) + 1e-12 * np.max(np.diag(H), initial=0.0) + 1e-300
        for _ in range(4):
            step = np.linalg.solve(H + damping * np.diag(size), g)
            trial = moved(effects, free, step)
            now = rows_of(problem, screened, trial, ())
            if now is not None and (new := float(np.sum((b.r - now[:, 0]) ** 2))) < cost:
                break
            damping = max(10 * damping, 1e-2)
        else:
            break
        gain, cost, effects, left = cost - new, new, trial, b.r - now[:, 0]
        damping = max(damping / 10, 1e-6)
        if gain < 2e-3 * cost:
            break
    return Polished(effects, float(b.r @ b.r) - cost, _theta(problem, screened, effects, cost))


def polished_candidate(problem: Problem, screened: Screen, candidate: Candidate) -> Candidate:
    """The candidate with its parameters fitted along the motion; as it was where that gains nothing.

    A changed input was judged with a factor of its own, which no effect has: there the fitted one may explain less.
    """
    if not polishable(candidate.effect):
        return candidate
    found = polish(problem, screened, (candidate.effect,))
    least = 0.8 if candidate.effect.path == "actuator" else 1.0
    if found is None or found.explained < least * candidate.explained or not drives(problem, found.effects):
        return candidate
    gain = found.explained - candidate.explained
    return replace(
        candidate, effect=found.effects[0], explained=found.explained, score=candidate.score + gain,
        theta=found.theta, origin=candidate.effect,
    )  # fmt: skip


def moved(effects: tuple[Effect, ...], free, step: Array) -> tuple[Effect, ...]:
    """The effects after a step; positive parameters by their logarithm."""
    values = [np.array(e.values) for e in effects]
    for (e, p), s in zip(free, step):
        if _by_log(effects[e], p):
            values[e][p] *= np.exp(np.clip(s, -LONGEST_STEP, LONGEST_STEP))
        else:
            values[e][p] += s
    return tuple(x.with_values(v) if len(v) else x for x, v in zip(effects, values))


def rows_of(problem: Problem, screened: Screen, effects: tuple[Effect, ...], free) -> Array | None:
    """(rows, 1 + len(free)) what the effects add to the rows, and its derivatives, beyond what the basis explains."""
    (b, point), parts = screened.ground, []
    for s in screened.seens:
        total, slopes = 0, []
        for e, effect in enumerate(effects):
            versions = [effect, *(_nudged(effect, p) for k, p in free if k == e)]
            columns = _responses(problem, point, s, versions)
            total = total + columns[:, :, :1]
            steps = np.array([_nudge(effect, p) for k, p in free if k == e])
            slopes.append((columns[:, :, 1:] - columns[:, :, :1]) / steps)
        parts.append(thin(s.trace.rows(np.concatenate([total, *slopes], axis=2))))
    A = np.concatenate([*parts, np.zeros((b.ridge, parts[0].shape[1]))])
    if not np.isfinite(A).all():
        return None
    return A - b.Q @ (b.Q.T @ A)


def _by_log(effect: Effect, p: int) -> bool:
    return effect.knobs[effect.numeric[p]].range == POSITIVE


def _nudge(effect: Effect, p: int) -> float:
    return 1e-3 if _by_log(effect, p) else 1e-3 * max(abs(effect.values[p]), 1e-3)


def _nudged(effect: Effect, p: int) -> Effect:
    return moved((effect,), ((0, p),), np.array([_nudge(effect, p)]))[0]


def _responses(problem: Problem, point: Point, s: Seen, versions: list[Effect]) -> np.ndarray:
    """(F, ny, len(versions)) response to each version of one effect."""
    one, n = versions[0], problem.model.n
    if one.path == "force":
        c = direction(one.dof, n)
        x, v = s.q @ c, s.v @ c
        return force_columns(s, c, forces_along(versions, x, v, s.trace.h, s.trace.t0))
    if one.path == "actuator":
        return np.concatenate([actuated_difference(problem, point, s, None, e) for e in versions], axis=2)
    return np.stack([mode_column(problem, s, e) for e in versions], axis=2)


def _theta(problem: Problem, screened: Screen, effects: tuple[Effect, ...], cost: float) -> Array:
    """theta beside these effects, held to the nominal no harder than what they leave calls for."""
    (b, point), nt = screened.ground, len(problem.entries)
    parts = []
    for s in screened.seens:
        total = sum((_responses(problem, point, s, [e]) for e in effects), np.zeros(()))
        parts.append(thin(s.trace.rows(total))[:, 0])
    f = np.concatenate([*parts, np.zeros(b.ridge)])
    ridge = slice(b.offset, b.offset + nt)
    softer = np.clip(cost / len(b.r), 1.0, b.noise**2) / b.noise**2
    W2, gram, right = b.held**2, b.R.T @ b.R, b.R.T @ (b.Q.T @ (b.target - f))
    gram[ridge, ridge] += np.diag((softer - 1) * W2)
    right[ridge] += (softer - 1) * -W2 * b.norms[ridge] * b.theta0
    x = np.linalg.lstsq(gram, right, rcond=1e-13)[0] / b.norms
    return np.clip(np.nan_to_num(b.theta0 + x[ridge]), -0.95, 2.0)
