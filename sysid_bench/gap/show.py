"""answer -> gap.json's content, prediction table, model origin: plain values, no drawing."""

from __future__ import annotations

from typing import Any

import numpy as np

from sysid_bench.gap.contend import DECOY_NAMES, Contender
from sysid_bench.gap.decide import moved_knobs, moves, practical_moves
from sysid_bench.gap.experiment import Settling
from sysid_bench.gap.inverse import ForceProblem
from sysid_bench.gap.reference import flexible_reference
from sysid_bench.gap.workflow import Answer
from sysid_bench.mechanics.effect import Effect

# What the evidence cannot split by itself, and why (same data).
ALIKE = {
    frozenset({"constant_force", "sensor_bias"}): "one DOF started at rest",
    frozenset({"input_delay", "actuator_lag"}): "to first order the same phase",
    frozenset({"input_delay", "wrong_hold"}): "half a sample of delay",
}
# A richer law holds the simpler one as a limit: no experiment speaks against it.
HELD = frozenset(
    {
        ("coulomb_friction", "stribeck_friction"), ("coulomb_friction", "presliding_friction"),
        ("coulomb_friction", "bouc_wen_hysteresis"), ("sensor_bias", "sensor_drift"),
    }
)  # fmt: skip


def gap_values(
    answer: Answer, thresholds, origin: dict[str, Any], settled: Settling | None = None
) -> dict[str, Any]:
    """The content of gap.json. settled: the experiment that would tell apart what these records do not."""
    effect = answer.verdict.word == "effect"
    return {
        "verdict": answer.verdict.word,
        "reason": answer.reason,
        "effects": [effect_values(answer, e) for e in answer.added if e.name not in DECOY_NAMES] if effect else [],
        "description": description(answer) if answer.verdict.word == "unknown" else None,
        "experiment": experiment_values(settled),
        "parameters_moved": moved_values(answer, thresholds),
        "where": where_values(answer),
        "noise_floor": answer.floor,
        "noise_floor_is": f"estimated {answer.floor_found}",
        "gap_is": "on the force" if answer.judged else "of the free run",
        "gap_before": answer.gap_before,
        "gap_after": answer.gap_after,
        "residual_over_floor": {
            "nominal": answer.nominal_rho, "refit": answer.story.linear.rho, "final": answer.story.fit.rho,
        },
        "force_gap": answer.force_gaps,
        "force_share": force_share(answer),
        "rounds": [round_values(r) for r in answer.story.rounds],
        "search_ended_early": answer.problem.budget.spent,
        "power": power_values(answer),
        "data": {
            "faults": [fault_values(f) for f in (*answer.check.faults, *answer.check.drives)],
            "remarks": answer.check.remarks,
        },
        "tests": [
            {"record": i, "gap_before": a.gap, "gap_after": b.gap, **free}
            for i, (a, b, free) in enumerate(_tests(answer))
        ],
        "origin": origin,
    }  # fmt: skip


def _tests(answer: Answer):
    """Per test record what the gap is taken from, before and after; where that is the force, the free run's error beside it."""
    if not answer.judged:
        return [(a, b, {}) for a, b in zip(answer.before, answer.after)]
    free = [{"free_run_before": a.gap, "free_run_after": b.gap} for a, b in zip(answer.before, answer.after)]
    return list(zip(answer.judged["given"], answer.judged["better"], free))


def force_share(answer: Answer) -> dict[str, float] | None:
    """|F - Fhat| / |F| on the training records of the refitted linear and the final model, where the force is judged."""
    if not isinstance(answer.problem, ForceProblem):
        return None
    missed = answer.problem.share_missed
    return {"refit": missed(answer.story.linear), "final": missed(answer.story.fit)}


ELSEWHERE = -0.02  # on the force, what takes so much more of the gap explains another part of it: no rival


def place_value(dof) -> Any:
    return list(dof) if isinstance(dof, tuple) else dof


def fault_values(fault) -> dict[str, Any]:
    return {
        "name": fault.name, "channel": fault.channel, "parameters": dict(fault.parameters), "evidence": dict(fault.evidence),
    }  # fmt: skip


def deviations(answer: Answer) -> dict[tuple[int, str], float]:
    """Standard error of each fitted parameter: (effect number, name) -> std in its unit."""
    fit = answer.story.fit
    if fit.covariance is None:
        return {}
    nt, out = len(answer.problem.entries), {}
    for k, (e, p) in enumerate(fit.parameters):
        variance = fit.covariance[nt + k, nt + k]
        effect = fit.point.effects[e]
        size = effect.values[p] if answer.problem.by_log(effect, p) else 1.0
        out[e, effect.numeric[p]] = float(np.sqrt(max(variance, 0.0)) * abs(size))
    return out


def effect_values(answer: Answer, effect: Effect) -> dict[str, Any]:
    """One entry of `effects`: name, place, parameters with standard errors, evidence, rivals, what would settle it."""
    entry = effect.as_dict()
    std = deviations(answer)
    effects = list(answer.story.fit.point.effects)
    number = next((k for k, e in enumerate(effects) if e is effect), -1)  # -1: not fitted, no deviation
    for key, parameter in entry["parameters"].items():
        if (number, key) in std:
            parameter["std"] = std[number, key]
    apart, not_apart = rivals(answer, effect)
    return {
        **entry,
        "equation": effect.equation,
        "evidence": evidence(answer, effect),
        "told_apart_from": apart,
        "not_told_apart_from": not_apart,
        "ask_for": f"{effect.reveals}" if effect.reveals else None,
    }


def evidence(answer: Answer, effect: Effect) -> dict[str, Any]:
    for fault in answer.check.faults:
        if fault.name == effect.name:
            return dict(fault.evidence)
    for r in answer.story.rounds:
        if r.chosen is not None and r.chosen.effect.name == effect.name:
            left = r.before.rss - len(r.before.rows)
            return {
                "share_of_gap_explained": float((r.before.rss - r.chosen.fit.rss) / max(left, 1e-9)),
                "residual_over_floor_before": r.before.rho,
                "residual_over_floor_after": r.chosen.fit.rho,
                "screen_share": float(r.chosen.candidate.explained / max(r.screen.left, 1e-9)),
            }
    return {}


def rivals(answer: Answer, effect: Effect) -> tuple[list, list]:
    """(told apart from, not told apart from): what else was fitted in the round that chose this effect."""
    apart, close = [], []
    own = {(e.name, e.dof) for e in answer.story.fit.point.effects}
    for r in answer.story.rounds:
        if r.chosen is None or r.chosen.effect.name != effect.name:
            continue
        for other in r.contenders:
            behind = float((other.cost - r.chosen.cost) / _linear_gap(r))
            if (other.effect.name, other.effect.dof) in own or (answer.judged and behind < ELSEWHERE):
                continue
            entry = {"name": other.effect.name, "dof": place_value(other.effect.dof), "behind": behind}
            (close if _is_close(r, other) else apart).append(entry)
    for pair, why in ALIKE.items():
        if effect.name in pair and answer.problem.model.n == 1:
            other = next(iter(pair - {effect.name}))
            if not any(x["name"] == other for x in apart + close):
                close.append({"name": other, "dof": place_value(effect.dof), "why": why})
    return apart, close


def _linear_gap(r) -> float:
    return max(r.before.rss - len(r.before.rows), 1.0)


def _is_close(r, other: Contender) -> bool:
    """True where the evidence for the chosen effect over this one is less than what matters."""
    return other.cost - r.chosen.cost <= max(20.0, 0.003 * _linear_gap(r))


def alike(answer: Answer) -> list[list[Contender]]:
    """The chosen effect of each round with the named ones that it was not told apart from; none where all were."""
    found = []
    for r in answer.story.rounds if answer.verdict.word == "effect" else []:
        if r.chosen is None:
            continue
        known = (r.chosen.effect.name, r.chosen.effect.dof)
        close = [c for c in r.contenders if not c.is_decoy and _is_close(r, c)]
        close = [c for c in close if (r.chosen.effect.name, c.effect.name) not in HELD]
        close = [c for c in close if (c.effect.name, c.effect.dof) != known]
        if close:
            found.append([r.chosen, *close])
    return found


def experiment_values(settled: Settling | None) -> dict[str, Any] | None:
    """What experiment.yaml holds, and how far apart the rivals would then be; None where nothing is left to settle."""
    if settled is None:
        return None
    return {
        "excitation": dict(settled.config), "seconds": settled.seconds, "between": list(settled.between),
        "squared_difference_over_noise": settled.difference, "settles": settled.settles,
    }  # fmt: skip


def description(answer: Answer) -> dict[str, Any]:
    """In plain words what the unexplained force is like: what fits best, whatever its name, and what any force could."""
    fit = answer.story.fit
    base = len(answer.problem.model.effects)
    found = [
        {"like": e.name, "dof": place_value(e.dof), "parameters": e.as_dict()["parameters"]}
        for e in fit.point.effects[base:]
    ]
    ranked = answer.story.rounds[-1].contenders[:5] if answer.story.rounds else []
    return {
        "found": found,
        "correlates_with": [contender_values(c) for c in ranked],
        "flexible_reference": reference_values(answer),
        "model": "model.yaml holds the refitted M, D, K and no effect: what has no name is not added",
    }


def reference_values(answer: Answer) -> list[dict[str, Any]]:
    """Per place: share of the unexplained energy that some force of its state, and that any force there, explains."""
    if answer.problem.on_force:
        return []
    return [
        {"dof": place_value(r.dof), "force_of_the_state": r.of_state, "any_force": r.of_any_force}
        for r in flexible_reference(answer.problem, answer.story.linear)
    ]


def contender_values(c: Contender) -> dict[str, Any]:
    return {
        "name": c.effect.name, "dof": place_value(c.effect.dof), "residual_over_floor": c.fit.rho, "cost": c.cost,
        "parameters": c.effect.as_dict()["parameters"],
    }  # fmt: skip


def round_values(r) -> dict[str, Any]:
    best = r.screen.candidates[:12]
    return {
        "before": r.before.rho,
        "screen": [
            {
                "name": c.effect.name,
                "dof": place_value(c.place),
                "explains": float(c.explained / max(r.screen.left, 1e-9)),
            }
            for c in best
        ],
        "fitted": [contender_values(c) for c in r.contenders],
        "chosen": None
        if r.chosen is None
        else {"name": r.chosen.effect.name, "dof": place_value(r.chosen.effect.dof)},
    }


def moved_values(answer: Answer, thresholds) -> list[dict[str, Any]]:
    if answer.verdict.word == "none":
        return []
    fit = answer.story.fit
    all_moves = moves(answer.problem, fit)
    entries = [all_moves[k] for k in practical_moves(answer.problem, fit, thresholds)]
    return entries + moved_knobs(answer.problem, fit, thresholds)


def where_values(answer: Answer) -> dict[str, Any]:
    """Which channel, which place, which frequencies, when: of what the linear refit leaves."""
    if not answer.story.rounds:
        return {}
    first = answer.story.rounds[0].screen
    lefts, traces = first.lefts, answer.problem.traces
    energy = sum((np.sum(np.abs(x) ** 2, axis=0) for x in lefts), np.zeros(()))
    places = sorted(first.by_place.items(), key=lambda item: -item[1])[:5]
    power = np.sum(np.abs(lefts[0]) ** 2, axis=1)
    omega = traces[0].omega
    order = np.cumsum(power) / max(power.sum(), 1e-300)
    low, high = (
        float(omega[min(np.searchsorted(order, q), len(omega) - 1)] / (2 * np.pi)) for q in (0.1, 0.9)
    )
    signal = traces[0].signal(lefts[0] / np.maximum(traces[0].weight, 1e-300))
    parts = np.array([np.mean(p**2) for p in np.array_split(signal, 10)])
    return {
        "channel_share": (energy / max(energy.sum(), 1e-300)).tolist(),
        "places": [{"dof": place_value(p), "explainable_share": float(s)} for p, s in places],
        "frequency_hz": {
            "from": low,
            "to": high,
            "largest": float(omega[int(np.argmax(power))] / (2 * np.pi)),
        },
        "share_by_tenth_of_record": (parts / max(parts.sum(), 1e-300)).tolist(),
    }


def power_values(answer: Answer) -> dict[str, Any]:
    """Smallest size of each single-parameter effect that would have been seen at its most visible place."""
    if answer.last_screen is None:
        return {}
    wanted = 30 + 4 * np.log(answer.last_screen.rows)
    sizes: dict[str, dict[str, Any]] = {}
    for c in answer.last_screen.candidates:
        keys = [k for k in c.effect.numeric if k not in c.effect.held]
        if c.decoy or c.effect.path != "force" or c.unit_energy <= 0 or not keys:
            continue
        size = float(np.sqrt(wanted / c.unit_energy))
        old = sizes.get(c.effect.name)
        if old is None or size < old["smallest"]:
            unit = c.effect.knobs[keys[0]].unit
            sizes[c.effect.name] = {
                "parameter": keys[0],
                "smallest": size,
                "unit": unit,
                "dof": place_value(c.place),
            }
    return sizes
