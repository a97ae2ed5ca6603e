"""answer of the gap workflow -> the words and numbers that its page and its recording share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sysid_bench.gap.answer import Answer
from sysid_bench.mechanics.effect import as_effects

WORDS = {
    "effect": "An effect is missing",
    "parameters": "Only parameters are wrong",
    "none": "Nothing is missing that these records can show",
    "unknown": "Something is missing, and it has no name here",
}

PATHS = {"actuator": "the drive gives", "sensor": "the sensor shows", "structure": "the structure has"}
SI = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s²"}


def place_words(dof: Any) -> str:
    """`everywhere`, `DOF 0` or `DOFs 0 and 1`."""
    if dof is None:
        return "everywhere"
    return f"DOFs {dof[0]} and {dof[1]}" if isinstance(dof, (list, tuple)) else f"DOF {dof}"


def unit_of(answer: Answer, channel: int) -> str:
    """Unit of an output: the model's word for it, else SI's."""
    model = answer.problem.model
    units = list(model.units.get("y") or [])
    return units[channel] if channel < len(units) else SI[model.output]


def equations(answer: Answer) -> list[tuple[str, str]]:
    """(which, equation) of the model as given and of the better one."""
    given = [
        e for e in as_effects(answer.problem.model.effects) if e.name != "constant_force" or e.value("force")
    ]
    return [("as given", equation(given)), ("better", equation(answer.better.effects))]


def equation(effects: Sequence[Any]) -> str:
    """The equation of motion, a line for each effect: forces on the left, what is no force below."""
    forces = [e for e in effects if e.path == "force"]
    lines = ["M q'' + D q' + K q", *(f"  + [{e.equation}] at {place_words(e.dof)}" for e in forces)]
    lines[-1] += " = L u"
    others = [e for e in effects if e.path != "force"]
    lines += [f"{PATHS.get(e.path, e.path)} {e.equation} at {place_words(e.dof)}" for e in others]
    return "\n".join(lines)


def suspects(values: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Rows of the ranking: round, name and place, share explained in the screen, rms over the floor left after the fit."""
    rows: dict[tuple[int, str, str], tuple[str, str, str, str]] = {}
    for k, r in enumerate(values["rounds"], start=1):
        left = {(c["name"], str(c["dof"])): f"{_rms(c['residual_over_floor']):.3g}" for c in r["fitted"]}
        for c in r["screen"]:
            who = (c["name"], str(c["dof"]))
            name, share = f"{c['name']} at {place_words(c['dof'])}", f"{100 * c['explains']:.1f} %"
            rows.setdefault((k, *who), (f"{k}", name, share, left.get(who, "")))
    return list(rows.values())


def _rms(energy: float) -> float:
    """Over the floor, of a ratio of energies."""
    return float(np.sqrt(max(energy, 1e-6)))


def budget(values: Mapping[str, Any]) -> list[tuple[str, float]]:
    """(step, rms over the floor) from the model as given down to the end."""
    over = values["residual_over_floor"]
    rows = [("model as given", over["nominal"]), ("M, D, K refitted", over["refit"])]
    for r in values["rounds"]:
        if r["chosen"]:
            who = [r["chosen"][key] for key in ("name", "dof")]
            left = (c["residual_over_floor"] for c in r["fitted"] if [c["name"], c["dof"]] == who)
            rows.append((f"+ {who[0]}", next(left)))
    return [(name, _rms(energy)) for name, energy in [*rows, ("noise floor", 1.0)] if np.isfinite(energy)]


def held_out(values: Mapping[str, Any]) -> list[tuple[str, float]]:
    """(which, per cent) of the given and the better model and the floor."""
    rows = (("model as given", "gap_before"), ("better model", "gap_after"), ("noise floor", "noise_floor"))
    return [(name, 100 * max(float(values[key]), 1e-9)) for name, key in rows if np.isfinite(values[key])]
