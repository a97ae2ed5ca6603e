"""answer, effect -> its entry of gap.json: sizes with standard errors, evidence, rivals."""

from __future__ import annotations

from typing import Any

import numpy as np

from sysid_bench.gap.answer import Answer
from sysid_bench.gap.rivals import rivals
from sysid_bench.mechanics.effect import Effect


def effect_values(answer: Answer, effect: Effect) -> dict[str, Any]:
    """One entry of `effects`: name, place, parameters with standard errors, evidence, rivals, what would settle it."""
    entry = effect.as_dict()
    std = deviations(answer)
    effects = list(answer.story.fit.point.effects)
    number = next((k for k, e in enumerate(effects) if e is effect), -1)  # -1: not fitted, no deviation
    for key, parameter in entry["parameters"].items():
        parameter["std"] = std.get((number, key))  # None: chosen or read off the data, not fitted
    apart, not_apart = rivals(answer, effect)
    return {
        **entry,
        "equation": effect.equation,
        "evidence": evidence(answer, effect),
        "told_apart_from": apart,
        "not_told_apart_from": not_apart,
        "ask_for": f"{effect.reveals}" if effect.reveals else None,
    }


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
