"""answer -> the content of gap.json: plain values, no drawing."""

from __future__ import annotations

from typing import Any

from sysid_bench.gap.answer import Answer
from sysid_bench.gap.decide import place_value
from sysid_bench.gap.evidence import effect_values
from sysid_bench.gap.experiment import Settling
from sysid_bench.gap.inverse import ForceProblem
from sysid_bench.gap.moves import moved_knobs, moves, practical_moves
from sysid_bench.gap.price import DECOY_NAMES
from sysid_bench.gap.unexplained import contender_values, description, power_values, where_values


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


def fault_values(fault) -> dict[str, Any]:
    return {
        "name": fault.name, "channel": fault.channel, "parameters": dict(fault.parameters), "evidence": dict(fault.evidence),
    }  # fmt: skip


def experiment_values(settled: Settling | None) -> dict[str, Any] | None:
    """What experiment.yaml holds, and how far apart the rivals would then be; None where nothing is left to settle."""
    if settled is None:
        return None
    return {
        "excitation": dict(settled.config), "seconds": settled.seconds, "between": list(settled.between),
        "squared_difference_over_noise": settled.difference, "settles": settled.settles,
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
