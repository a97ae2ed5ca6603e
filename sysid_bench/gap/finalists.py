"""screen -> the suspects worth a simulation, their shapes polished; and relatives of an effect already fitted."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from sysid_bench.effects import effect_class
from sysid_bench.gap.candidates import Candidate, Screen
from sysid_bench.gap.descent import Fit
from sysid_bench.gap.polish import polished_candidate
from sysid_bench.gap.problem import Problem
from sysid_bench.mechanics.effect import Effect, direction

FRICTION = ("coulomb_friction", "stribeck_friction", "presliding_friction")
POOL = 24  # suspects whose shapes are polished
NEARLY = (1.0, 1.02)  # of the level: a Stribeck friction that starts as the Coulomb friction that was fitted
PROMISING = 0.3  # of the best: what a suspect off its grid must explain to be polished


def polished_screen(problem: Problem, screened: Screen, worth: float = 0.0) -> Screen:
    """The screen with its best suspects polished: two starts per name and place, then the better one alone.

    worth: energy that the best must explain before anything is polished
    """
    if not screened.candidates or screened.candidates[0].explained < worth:
        return screened
    best = screened.candidates[0].explained
    pool: list[Candidate] = []
    for c in screened.candidates:
        same = [x for x in pool if _same(x, c)]
        if c.explained < PROMISING * best or len(pool) >= POOL or len(same) >= 2:
            continue
        pool.append(c)
    polished = [polished_candidate(problem, screened, c) for c in pool]
    kept: list[Candidate] = []
    for c in sorted(polished, key=lambda c: -c.score):
        if not any(_same(x, c) for x in kept):
            kept.append(c)
    chosen = {id(c) for c in pool}
    rest = [c for c in screened.candidates if id(c) not in chosen]
    return replace(screened, candidates=sorted([*kept, *rest], key=lambda c: -c.score))


def _same(one: Candidate, other: Candidate) -> bool:
    return one.effect.name == other.effect.name and one.place == other.place


def shortlist(screened: Screen, most: int) -> list[Candidate]:
    """Suspects worth a simulation: at least half of the best, two places per name, one of each at a place.

    Unnamed shapes come on top of `most`: they take no name's place.
    """
    out: list[Candidate] = []
    if not screened.candidates:
        return out
    best = screened.candidates[0].explained
    for c in screened.candidates:
        if c.explained < max(0.5 * best, 15) or sum(not x.decoy for x in out) >= most:
            break
        family = "decoy" if c.decoy else c.effect.name
        same = [x for x in out if ("decoy" if x.decoy else x.effect.name) == family]
        if len(same) >= 2 or any(_same(x, c) for x in out):
            continue
        out.append(c)
    out += _located(screened, out)
    return out + _beside_coulomb(screened, out)


def _located(screened: Screen, chosen: list[Candidate]) -> list[Candidate]:
    """Where a force at one place, and no other, would explain it all, that place's best names are tried too.

    Friction that sticks is seen so: no regressor shows it, for the motion is zero.
    """
    ranked = sorted(screened.by_place.items(), key=lambda item: -item[1])
    if len(ranked) < 2 or ranked[0][1] < 0.9 or (1 - ranked[0][1]) > 0.3 * (1 - ranked[1][1]):
        return []
    if chosen[0].explained > 0.9 * screened.left:
        return []
    out: list[Candidate] = []
    for c in screened.candidates:
        known = any(_same(x, c) for x in (*chosen, *out))
        if c.place == ranked[0][0] and not c.decoy and not known and len(out) < 3:
            out.append(c)
    return out


def _beside_coulomb(screened: Screen, chosen: list[Candidate]) -> list[Candidate]:
    """Stribeck and presliding friction beside a suspected Coulomb friction: they differ only at low speed."""
    out = []
    for c in [x for x in chosen if x.effect.name == "coulomb_friction"][:1]:
        for name in ("stribeck_friction", "presliding_friction"):
            if any(x.effect.name == name and x.place == c.place for x in chosen):
                continue
            out += [x for x in screened.candidates if x.effect.name == name and x.place == c.place][:1]
    return out


def relatives(problem: Problem, fit: Fit, effect: Effect) -> dict[str, list[Effect]]:
    """Laws near to the effect's at the same place, by name: where to start fitting them from. Most effects have none."""
    if effect.name in FRICTION:
        return _frictions_like(problem, fit, effect)
    return _coupling_like(problem, effect) if effect.name == "end_stop" else {}


def _coupling_like(problem: Problem, effect: Effect) -> dict[str, list[Effect]]:
    """The coupling that an end stop without gap is, where the model has none. It has a parameter less."""
    _, _, K = problem.model.matrices
    if not isinstance(effect.dof, tuple) or K[effect.dof] != 0:
        return {}
    kind: Any = effect_class("missing_coupling")
    return {kind.name: [kind(effect.dof, effect.value("stiffness"), effect.value("damping"))]}


def _frictions_like(problem: Problem, fit: Fit, effect: Effect) -> dict[str, list[Effect]]:
    """Other frictions of the same level.

    A screen sees them badly: they differ where the motion is slow, and there its speed is mostly noise.
    """
    c = direction(effect.dof, problem.model.n)
    n = problem.model.n
    X = fit.runs[0].X
    x_rms, v_rms = float((X[:, :n] @ c).std()), float((X[:, fit.runs[0].assembly.n :][:, :n] @ c).std())
    v = dict(zip(effect.numeric, effect.values))
    level = 0.5 * (v["force"] + v["static_force"]) if "static_force" in v else v["force"]
    speed = min(v.get("speed", 0.0), 0.05 * v_rms) or 0.01 * v_rms
    kinds: list[Any] = [effect_class(name) for name in FRICTION]
    coulomb, stribeck, presliding = kinds
    found = {
        "coulomb_friction": [coulomb(effect.dof, level, speed)],
        "stribeck_friction": [
            stribeck(effect.dof, low * level, high * level, f * v_rms, speed)
            for f in (0.08, 0.2, 0.5)
            for low, high in ((0.75, 1.4), NEARLY)
        ],
        "presliding_friction": [presliding(effect.dof, level, level / (f * x_rms)) for f in (0.02, 0.1, 0.3)],
    }
    return {name: starts for name, starts in found.items() if name != effect.name}
