"""judged trials -> tables: per stratum and kind with Wilson intervals, by strength, coverage of intervals, a csv."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

GROUPS = ("single", "single, weak", "double", "none", "parameters", "unknown")
EDGES = (0.0, 1.1, 1.5, 2.0, 4.0, 10.0, np.inf)  # refit-linear error over noise-limited error
SIZES = ("one", "three", "eight")


def wilson(hits: int, trials: int, z: float = 1.96) -> tuple[float, float]:
    """95 % interval of a share (Wilson 1927)."""
    if trials == 0:
        return 0.0, 1.0
    p, w = hits / trials, z * z / trials
    middle = (p + w / 2) / (1 + w)
    half = z * np.sqrt(p * (1 - p) / trials + w / (4 * trials)) / (1 + w)
    return max(0.0, middle - half), min(1.0, middle + half)


def share(rows: list[dict], key: str | Callable[[dict], bool]) -> str:
    """`95.3 (92.1..97.2)` per cent of the rows."""
    if not rows:
        return "-"
    hits = sum(bool(key(r) if callable(key) else r[key]) for r in rows)
    low, high = wilson(hits, len(rows))
    return f"{100 * hits / len(rows):.1f} ({100 * low:.0f}..{100 * high:.0f})"


COLUMNS = (
    "trials", "verdict", "names", "names or class", "located", "F1", "wrong or false name", "unknown", "missed",
    "shrink of oracle's", "error over floor", "cpu s 1, 3, 8 DOF",
)  # fmt: skip


def line(rows: list[dict]) -> list[str]:
    """The columns of one group of trials."""
    named = bool(rows[0]["true"])
    shrinks = [min(r["shrink"], 1.0) for r in rows if r["shrink"] is not None]
    over = [r["over_floor"] for r in rows if r["over_floor"] is not None]
    cpu = [np.median([r["cpu_s"] for r in rows if r["size"] == s] or [np.nan]) for s in SIZES]
    return [
        str(len(rows)),
        share(rows, "verdict_right"),
        share(rows, "names_right") if named else "",
        share(rows, "in_class") if named else "",
        share(rows, "located") if named else "",
        f"{np.mean([r['f1'] for r in rows]):.3f}" if named else "",
        share(rows, "false_name"),
        share(rows, "honest"),
        share(rows, "missed") if named else "",
        f"{100 * np.mean(shrinks):.1f}, median {100 * np.median(shrinks):.1f}" if shrinks else "",
        f"{np.median(over):.2f}" if over else "",
        ", ".join("-" if np.isnan(c) else f"{c:.1f}" for c in cpu),
    ]


def groups(rows: list[dict]) -> list[tuple[str, list[dict]]]:
    """(stratum and kind, its rows) in a fixed order, those without rows left out."""
    strata = list(dict.fromkeys(r["stratum"] for r in rows))
    strata.sort(key=lambda s: s != "main")
    found = []
    for stratum in strata:
        for kind in GROUPS:
            chosen = [r for r in rows if r["stratum"] == stratum and r["group"] == kind]
            if chosen:
                found.append((kind if stratum == "main" else f"{stratum}: {kind}", chosen))
    return found


def table(rows: list[dict]) -> str:
    """Accuracy per stratum and kind, in per cent with 95 % intervals, as a markdown table."""
    return markdown(("", *COLUMNS), [[name, *line(chosen)] for name, chosen in groups(rows)])


def markdown(head: tuple[str, ...], body: list[list[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in body)])


def by_strength(rows: list[dict]) -> str:
    """Singles of the main table by how far the refitted linear model stays above the noise."""
    singles = [r for r in rows if r["stratum"] == "main" and r["kind"] == "single"]
    body = []
    for low, high in pairwise(EDGES):
        chosen = [r for r in singles if low <= np.sqrt(r["linear_rho"]) < high]
        name = f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} and more"
        body.append([
            name, str(len(chosen)), share(chosen, "names_right"), share(chosen, "located"), share(chosen, "false_name"),
            share(chosen, "missed"),
        ])  # fmt: skip
    return markdown(("linear error over noise", "trials", "names", "located", "wrong name", "missed"), body)


def by_name(rows: list[dict]) -> str:
    """Singles of the main table by their true effect."""
    singles = [r for r in rows if r["stratum"] == "main" and r["group"] == "single"]
    names = sorted({r["true"][0][0] for r in singles})
    chosen = {name: [r for r in singles if r["true"][0][0] == name] for name in names}
    body = [[n, str(len(x)), share(x, "names_right"), share(x, "located")] for n, x in chosen.items()]
    return markdown(("effect", "trials", "named", "located"), body)


def coverage(rows: list[dict]) -> str:
    """How often the 95 % intervals hold the truth: parameters of effects named and placed right, entries of M, D, K."""
    seen: dict[str, list[int]] = {}
    for r in rows:
        for name, key, hit in r["inside"]:
            seen.setdefault(f"{name}.{key}", []).append(hit)
    body = [[key, str(len(x)), share([{"hit": v} for v in x], "hit")] for key, x in sorted(seen.items())]
    every = [{"hit": v} for x in seen.values() for v in x]
    body.append(["all parameters of effects", str(len(every)), share(every, "hit")])
    right = [r for r in rows if r["within"] and r["verdict_right"] and (r["names_right"] or not r["true"])]
    for m in "MDK":
        hits, total = (sum(r["within"][m][k] for r in right) for k in (0, 1))
        if total:
            body.append([f"entries of {m}, structure right", str(total), f"{100 * hits / max(total, 1):.1f}"])
    return markdown(("parameter", "intervals", "hold the truth, %"), body)


CSV = "stratum,kind,seed,size,excitation,snr_db,true,outside,verdict,said,linear_rho,rho,shrink,over_floor,cpu_s"


def csv(rows: list[dict]) -> str:
    """One line per trial."""
    return "\n".join([CSV, *(_csv_line(r) for r in rows)]) + "\n"


def _csv_line(r: dict) -> str:
    def words(found: list) -> str:
        return "+".join(f"{n}@{p}".replace(", ", "-").strip() for n, p in found)

    number = {k: "" if r[k] is None else f"{r[k]:.4g}" for k in ("shrink", "over_floor")}
    return ",".join([
        r["stratum"], r["kind"], str(r["seed"]), r["size"], r["excitation"], f"{r['snr_db']:.0f}", words(r["true"]),
        r["outside"] or "", r["verdict"], words(r["said"]), f"{r['linear_rho']:.4g}", f"{r['rho']:.4g}", number["shrink"],
        number["over_floor"], f"{r['cpu_s']:.1f}",
    ])  # fmt: skip
