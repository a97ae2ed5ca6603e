"""tables of studies -> a page: method x plant x h x SNR, errors over the Cramer-Rao bound, failures, milliseconds.

python -m sysid_bench.views.leaderboard RESULTS_DIR PAGE.md
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

STUDY = "leaderboard"
POINT = ("plant", "noise.snr_db", "sampling.h_s")
HEAD = """# Leaderboard

S = root mean square over runs of error / Cramer-Rao bound of the very record (relative Frobenius norms): 1 is the best that
any unbiased method can do, on average. Failures are runs without an estimate; they are left out of S and counted beside it. The
median says what a typical run gives where S is ruled by a few. N = 6000 samples, cubic noise force, white noise,
one core; ms is that of the fastest run of a point (a busy machine slows the others), the median over the points. Made by `make leaderboard`.
"""


def rows_of(path: Path) -> list[dict[str, Any]]:
    """The rows of a table. Raises FileNotFoundError where the study was not run."""
    import pyarrow.parquet as pq

    return pq.read_table(path).to_pylist()


def leaderboard(rows: Sequence[dict[str, Any]]) -> str:
    """The page in Markdown: one table per plant and SNR, methods by their worst S."""
    parts = [HEAD]
    points = sorted({tuple(row[k] for k in POINT) for row in rows}, key=lambda p: (p[0], -p[1], -p[2]))
    for plant, snr in dict.fromkeys(p[:2] for p in points):
        steps = [p[2] for p in points if p[:2] == (plant, snr)]
        chosen = [row for row in rows if (row["plant"], row["noise.snr_db"]) == (plant, snr)]
        parts.append(f"\n## {plant}, {snr:g} dB\n\n{_table(chosen, steps)}\n")
    return "".join(parts)


def _table(rows: Sequence[dict[str, Any]], steps: Sequence[float]) -> str:
    lines = [
        "| method | " + " | ".join(f"h = {h:g} s" for h in steps) + " | ms |",
        "|---" * (len(steps) + 2) + "|",
    ]
    lines.append("| *bound* | " + " | ".join("1 / 1 / 1" for _ in steps) + " | |")
    named = {name: [row for row in rows if row["method"] == name] for name in {row["method"] for row in rows}}
    for name, own in sorted(named.items(), key=lambda item: _worst(item[1])):
        cells = [_cell([row for row in own if row["sampling.h_s"] == h]) for h in steps]
        lines.append(f"| {name} | " + " | ".join(cells) + f" | {_milliseconds(own)} |")
    return "\n".join(lines)


def _ratios(rows: Iterable[dict[str, Any]]) -> np.ndarray:
    """(runs, 3) error over bound of M, D, K of the runs that gave them."""
    found = [[row[f"{x}_over_bound"] for x in "MDK"] for row in rows if row["status"] == "ok"]
    ratios = np.array(found, dtype=float).reshape(-1, 3)
    return ratios[np.isfinite(ratios).all(axis=1)]


def _worst(rows: Sequence[dict[str, Any]]) -> float:
    ratios = _ratios(rows)
    return float(np.median(ratios)) if len(ratios) else np.inf


def _cell(rows: Sequence[dict[str, Any]]) -> str:
    ratios = _ratios(rows)
    failed = len(rows) - len(ratios)
    if not len(ratios):
        return f"{failed} of {len(rows)} fail"
    S, median = np.sqrt(np.mean(ratios**2, axis=0)), np.median(ratios, axis=0)
    text = " / ".join(_number(x) for x in S)
    if S.max() > 3 * median.max():
        text += " (median " + " / ".join(_number(x) for x in median) + ")"
    return text + (f", {failed} of {len(rows)} fail" if failed else "")


def _number(x: float) -> str:
    return f"{x:.2f}" if x < 10 else f"{x:.0f}" if x < 1e4 else f"{x:.0e}"


def _milliseconds(rows: Sequence[dict[str, Any]]) -> str:
    fastest: dict[float, float] = {}
    for row in rows:
        if row["status"] == "ok" and row["fit_s"]:
            h = row["sampling.h_s"]
            fastest[h] = min(fastest.get(h, np.inf), row["fit_s"])
    return f"{1e3 * float(np.median(list(fastest.values()))):.0f}" if fastest else ""


def main(arguments: Sequence[str]) -> int:
    """Writes the page; 2 where the study is missing."""
    results, page = (Path(a) for a in arguments)
    table = results / STUDY / "table.parquet"
    if not table.exists():
        print(
            f"{table} is missing: run `sysid-bench sweep experiment=at_the_bound/leaderboard` first.",
            file=sys.stderr,
        )
        return 2
    page.write_text(leaderboard(rows_of(table)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
