"""answer, sealed truth -> what was right: the only place where both meet."""

from __future__ import annotations

from typing import Any

import numpy as np

WORTH = 1.5  # refit-linear error over noise-limited error from which a single effect counts in the main table
DATA_FAULTS = ("quantisation", "sensor_clipping")
CERTAIN = 1.96
NOT_COMPARED = ("speed", "exponent", "side")  # smoothing of a sign; chosen from a few, not fitted
MATTERS = 0.05  # of the gap: an oracle that closes less shows no shrink


def place(dof: Any) -> Any:
    return tuple(sorted(dof)) if isinstance(dof, (list, tuple)) else dof


def judge(answer: dict, truth: dict) -> dict[str, Any]:
    """One scored trial. located: each true place carries something that was said, whatever its name."""
    said = [(e["name"], place(e["dof"])) for e in answer.get("said", [])]
    named = said if answer["verdict"] == "effect" else []
    true = [(e["name"], place(e["dof"])) for e in truth["effects"]]
    names, spoken = [n for n, _ in true], [n for n, _ in named]
    hits = sum(min(names.count(n), spoken.count(n)) for n in set(names))
    return {
        **{k: truth[k] for k in ("seed", "stratum", "kind", "size", "excitation", "snr_db")},
        "outside": truth.get("outside"), "true": true, "verdict": answer["verdict"], "said": named,
        "linear_rho": answer.get("linear_rho", np.nan), "rho": answer.get("rho", np.nan), "cpu_s": answer["cpu_s"],
        "group": group(answer, truth),
        "verdict_right": answer["verdict"] == truth["verdict"],
        "names_right": sorted(names) == sorted(spoken),
        "in_class": sorted(names) == sorted(spoken) or _in_class(answer, true),
        "f1": 2 * hits / max(len(names) + len(spoken), 1) if names else float(not named),
        "located": bool(true) and all(p in [q for _, q in said] for _, p in true),
        "false_name": len(spoken) > hits,
        "honest": answer["verdict"] == "unknown",
        "missed": bool(true) and answer["verdict"] in ("none", "parameters"),
        "shrink": shrink(answer, truth), "over_floor": _over_floor(answer, truth),
        "inside": inside(answer, truth), "within": truth.get("within"),
    }  # fmt: skip


def _in_class(answer: dict, true: list) -> bool:
    """True where each true effect was named, or said not to be told apart from what was named."""
    if answer["verdict"] != "effect" or len(answer["said"]) != len(true):
        return False
    classes = [{e["name"], *(name for name, _ in e["alike"])} for e in answer["said"]]
    return all(any(name in words for words in classes) for name, _ in true)


def group(answer: dict, truth: dict) -> str:
    """A single effect that the refit almost swallows is counted apart; so is one that only the data carry."""
    if truth["kind"] != "single" or any(e["name"] in DATA_FAULTS for e in truth["effects"]):
        return truth["kind"]
    return "single, weak" if answer.get("linear_rho", np.inf) < WORTH**2 else "single"


def shrink(answer: dict, truth: dict) -> float | None:
    """Share of the held-out gap that an oracle removes, removed."""
    if truth.get("oracle") is None or "gap_before" not in answer:
        return None
    possible = answer["gap_before"] - truth["oracle"]
    if possible < MATTERS * answer["gap_before"]:
        return None
    return (answer["gap_before"] - answer["gap_after"]) / possible


def _over_floor(answer: dict, truth: dict) -> float | None:
    if "gap_after" not in answer or not truth.get("noise_share"):
        return None
    return answer["gap_after"] / truth["noise_share"]


def inside(answer: dict, truth: dict) -> list[list[Any]]:
    """[effect, parameter, 1 where the 95 % interval holds the truth] of what was named and placed right."""
    out: list[list[Any]] = []
    for true in truth["effects"]:
        for e in answer.get("said", []) if answer["verdict"] == "effect" else []:
            if e["name"] != true["name"] or place(e["dof"]) != place(true["dof"]):
                continue
            for key, value in true["values"].items():
                got, std = e["values"].get(key, [0.0, 0.0])
                if std > 0 and key not in NOT_COMPARED:
                    out.append([e["name"], key, int(abs(off(key, got - value)) <= CERTAIN * std)])
    return out


def off(key: str, x: float) -> float:
    return (x + np.pi) % (2 * np.pi) - np.pi if key == "phase" else x
