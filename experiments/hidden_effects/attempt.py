"""one hidden trial -> the workflow's answer, and apart from it what is sealed: the truth, and what an oracle reaches.

The oracle knows the missing effects, their places and true sizes, and fits them by the workflow's own fit.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from draw import Draw
from trial import Trial

from sysid_bench.effects import effect_class
from sysid_bench.gap.answer import Answer
from sysid_bench.gap.contend import best_start
from sysid_bench.gap.descent import Fit, fit, free_parameters
from sysid_bench.gap.evidence import deviations
from sysid_bench.gap.problem import Budget, Point, Problem
from sysid_bench.gap.prove import prove
from sysid_bench.gap.rivals import rivals
from sysid_bench.gap.workflow import find_gap
from sysid_bench.mechanics.effect import Effect
from sysid_bench.nouns import InputError, Model, Record

CERTAIN = 1.96  # standard errors of a 95 % interval


def records_of(trial: Trial) -> tuple[list[Record], list[Record]]:
    """(training records, test records) as the workflow gets them."""
    made = [
        Record(np.arange(len(u)) * trial.h, u, y, hold=trial.hold, quality=quality)
        for (u, y), quality in zip((trial.train, trial.test, *trial.more), trial.quality)
    ]
    return [made[0], *made[2:]], [made[1]]


def model_of(trial: Trial) -> Model:
    return Model(
        trial.M, trial.D, trial.K, input_map=trial.L, output_map=trial.C, hold=trial.hold, initial_state=trial.initial_state,
    )  # fmt: skip


def attempt(seed: int, oracle_every: int = 1, **drawn: Any) -> tuple[dict, dict] | None:
    """(answer, sealed) of one trial. None where the drawn plant is no fair case (its motion leaves every bound).

    oracle_every: the oracle is asked where this divides the seed, for it costs as much as the answer.
    """
    trial = Draw(seed, **drawn).trial()
    if trial.truth["bad"]:
        return None
    key = {"seed": seed, "stratum": trial.truth["stratum"], "kind": trial.truth["kind"]}
    train, test = records_of(trial)
    model, begun = model_of(trial), time.process_time()
    try:
        found = find_gap(train, test, model, power=False)
    except Exception as trouble:  # a crash is an answer, and a wrong one
        word = "refused" if isinstance(trouble, InputError) else "crash"
        reason = f"{type(trouble).__name__}: {trouble}"[:200]
        return {
            **key,
            "verdict": word,
            "reason": reason,
            "cpu_s": time.process_time() - begun,
        }, trial.truth | key
    answer = {**key, **answer_values(found), "cpu_s": time.process_time() - begun}
    return answer, trial.truth | key | sealed_values(trial, found, test, seed % oracle_every == 0)


def answer_values(found: Answer) -> dict[str, Any]:
    """What the workflow says, without the truth."""
    std = deviations(found)
    effects = list(found.story.fit.point.effects)
    spoken = (
        effects if found.verdict.word == "unknown" else found.added
    )  # of an unknown, only the place counts
    return {
        "verdict": found.verdict.word, "said": [_said(found, e, effects, std) for e in spoken],
        "nominal_rho": found.nominal_rho, "linear_rho": found.story.linear.rho, "rho": found.story.fit.rho,
        "gap_before": found.gap_before, "gap_after": found.gap_after, "floor": found.floor,
        "rounds": [
            [[c.effect.name, c.effect.dof, round(c.fit.rho, 3), round(c.cost - r.contenders[0].cost, 1)] for c in r.contenders[:5]]
            for r in found.story.rounds
        ],
    }  # fmt: skip


def _said(found: Answer, effect: Effect, effects: list[Effect], std: dict) -> dict[str, Any]:
    number = next((k for k, e in enumerate(effects) if e is effect), None)
    values = {
        key: [float(getattr(effect, key)), float(std.get((number, key), 0.0))] for key in effect.numeric
    }
    alike = [[x["name"], x["dof"]] for x in rivals(found, effect)[1]]
    return {"name": effect.name, "dof": effect.dof, "values": values, "alike": alike}


def sealed_values(trial: Trial, found: Answer, test: list[Record], ask: bool) -> dict[str, Any]:
    """What only who knows the truth can say: the oracle's gap, and how many entries of M, D, K lie in their intervals."""
    true = [np.array(X) for X in trial.truth["true"]]
    for effect in trial.truth["effects"]:
        if effect["name"] == "missing_coupling":  # the model's own share of the matrices
            c = np.zeros(len(true[0]))
            c[effect["dof"]] = 1, -1
            true[1] = true[1] - effect["values"]["damping"] * np.outer(c, c)
            true[2] = true[2] - effect["values"]["stiffness"] * np.outer(c, c)
    oracle = None
    if ask and trial.truth["verdict"] in ("effect", "parameters"):
        oracle = oracle_gap(replace(found.problem, budget=Budget()), true, trial.truth["effects"], test)
    return {"oracle": oracle, "within": entries_within(found, true)}


def entries_within(found: Answer, true: list[np.ndarray]) -> dict[str, list[int]]:
    """{"M": [entries whose 95 % interval holds the truth, entries that are free], "D": ..., "K": ...}."""
    out = {name: [0, 0] for name in "MDK"}
    one, problem = found.story.fit, found.problem
    if one.covariance is None:
        return out
    std = np.sqrt(np.maximum(np.diag(one.covariance)[: len(problem.entries)], 0)) * problem.scale
    now = problem.matrices(one.point.theta)
    for (m, i, j), s in zip(problem.entries, std):
        out["MDK"[m]][0] += int(abs(now[m][i, j] - true[m][i, j]) <= CERTAIN * s)
        out["MDK"[m]][1] += 1
    return out


def oracle_gap(
    problem: Problem, true: list[np.ndarray], effects: list[dict], test: list[Record]
) -> float | None:
    """Held-out gap of the true structure, fitted from its true values. None where that cannot be simulated."""
    missing = tuple(e for x in effects if (e := true_effect(x)) is not None)
    theta = [
        (true[m][i, j] - getattr(problem.model, ("mass", "damping", "stiffness")[m])[i, j]) / scale
        for (m, i, j), scale in zip(problem.entries, problem.scale)
    ]
    every = (*problem.model.effects, *missing)
    best = best_start(problem, [Point(np.array(theta), every, problem.nominal().starts)])
    found = fit(problem, best[1], free_parameters(every), iterations=15) if best is not None else None
    return None if found is None else float(np.sqrt(np.mean([_gap(problem, found, r) ** 2 for r in test])))


def _gap(problem: Problem, found: Fit, record: Record) -> float:
    M, D, K = problem.matrices(found.point.theta)
    model = replace(problem.model, mass=M, damping=D, stiffness=K, effects=found.point.effects)
    return prove(model, record).gap


def true_effect(entry: dict[str, Any]) -> Effect | None:
    """The catalogue's effect with the true values; None for faults of the data that no simulation needs."""
    if entry["name"] in ("quantisation", "sensor_clipping"):
        return None
    dof = tuple(entry["dof"]) if isinstance(entry["dof"], list) else entry["dof"]
    return effect_class(entry["name"])(dof=dof, **entry["values"])
