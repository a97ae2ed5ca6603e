"""answer -> what is left, in plain values: where it acts, what it is like, what would have been seen."""

from __future__ import annotations

from typing import Any

import numpy as np

from sysid_bench.gap.answer import Answer
from sysid_bench.gap.decide import place_value
from sysid_bench.gap.pieces import wholes
from sysid_bench.gap.price import Contender
from sysid_bench.gap.reference import flexible_reference


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


def where_values(answer: Answer) -> dict[str, Any]:
    """Which channel, which place, which frequencies, when: of what the linear refit leaves."""
    if not answer.story.rounds:
        return {}
    first = answer.story.rounds[0].screen
    lefts, traces = first.lefts, wholes(answer.problem.traces)
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
