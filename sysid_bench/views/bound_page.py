"""finished studies -> a page: errors over the Cramer-Rao bound, shares of runs near it, failures, one table per study.

python -m sysid_bench.views.bound_page RESULTS_DIR PAGE.md
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench.nouns import InputError
from sysid_bench.views.study import Columns, Study, read_study

STUDIES = (
    "at_the_bound/three_dof",
    "at_the_bound/eight_dof",
    "at_the_bound/conditions",
    "at_the_bound/low_snr",
    "at_the_bound/input_noise",
    "at_the_bound/order_selection",
    "at_the_bound/tustin",
    "peers/peers",
    "peers/slow_peers",
)
FIRST = {
    "plant": "plant", "excitation": "force", "noise": "noise", "sampling.h_s": "h, s", "noise.snr_db": "dB", "method": "method",
}  # fmt: skip
DULL = ("analysis.knot_spacing_s", "excitation.knot_spacing_s")  # go with the plant or the force
NEAR = 1.3  # of the bound
SAME_MAXIMUM = 1.0  # of log-likelihood
HEAD = f"""# At the bound

S = root mean square over runs of error / Cramér-Rao bound of the very record (relative Frobenius norms), for M / D / K: 1 is the
best that any unbiased method can do. "Near" is the share of runs in which all three are within {NEAR} of their bounds; an estimate that
is exactly at the bound is there in about 60 % of runs on three masses and 85 % on eight, by chance alone. N = 6000 samples, cubic noise force unless said otherwise. A failure is a
run without an estimate. Wall-clock time of a fit: the fastest run, since a busy machine slows the others. Made by `make bound`.
"""
Rows = np.ndarray  # (rows,) bool
Cell = Callable[[Columns, Rows], str]


def bound_page(results: str | Path) -> str:
    """The page in Markdown, of those studies that were run. Raises InputError where none was."""
    studies = [
        read_study(folder.parent)
        for name in STUDIES
        if (folder := Path(results) / name / "table.parquet").is_file()
    ]
    if not studies:
        raise InputError(f"{results}: none of {', '.join(STUDIES)} was run; `make bound` runs them.")
    return HEAD + "".join(_section(study) for study in studies)


def _section(study: Study) -> str:
    heads, points = _points(study)
    cells = _cells(study.columns)
    lines = ["| " + " | ".join([*heads, *cells]) + " |", "|---" * (len(heads) + len(cells)) + "|"]
    for point in dict.fromkeys(points):
        rows = np.array([other == point for other in points])
        lines.append(
            "| " + " | ".join([*point, *(cell(study.columns, rows) for cell in cells.values())]) + " |"
        )
    question, name = study.manifest.get("question", ""), study.name
    return (
        f"\n## {study.name}\n\n{question} `sysid-bench sweep experiment={name}`\n\n" + "\n".join(lines) + "\n"
    )


def _points(study: Study) -> tuple[list[str], list[tuple[str, ...]]]:
    """Headings, and per row the words of what tells points apart: some in columns, the rest as one condition."""
    config = study.config
    cased = [key for case in config.get("cases") or [] for key in case]
    keys: list[str] = list(dict.fromkeys([*FIRST, *cased, *(config.get("axes") or {})]))
    words = {key: [_word(v) for v in study.columns[key]] for key in keys if key in study.columns}
    words = {key: column for key, column in words.items() if len(set(column)) > 1 and key not in DULL}
    alone = [key for key in words if key in FIRST]
    rest = [key for key in words if key not in FIRST]
    columns = [words[key] for key in alone]
    if rest:
        columns.append([_condition(rest, row) for row in zip(*(words[key] for key in rest), strict=True)])
    heads = [FIRST[key] for key in alone] + (["condition"] if rest else [])
    return heads, list(zip(*columns, strict=True)) if columns else [()] * study.rows


def _condition(keys: Sequence[str], row: Sequence[str]) -> str:
    return ", ".join(f"{key.split('.')[-1]} {word}" for key, word in zip(keys, row, strict=True) if word)


def _word(value: Any) -> str:
    if isinstance(value, float | np.floating):
        return "" if np.isnan(value) else f"{value:g}"
    return str(value)


def _cells(columns: Columns) -> dict[str, Cell]:
    """Heading -> what to say of the rows of a point, as far as the table has it."""
    found: dict[str, Cell] = {"runs": lambda c, rows: str(np.count_nonzero(rows)), "failed": _failures}
    if "right" in columns:
        return found | {"right": lambda c, rows: _percent(c["right"][_good(c, rows)] == 1, rows)}
    found["S of M / D / K"] = lambda c, rows: _of_three(c, rows, "_over_bound", _rms)
    if "method" in columns:
        found["median error of M / D / K, %"] = lambda c, rows: _of_three(c, rows, "_error", _median_percent)
        found["median error of the poles, %"] = lambda c, rows: _median_percent(
            _numbers(c, rows, "pole_error")
        )
        if "fit_s" in columns and len(set(columns["method"])) > 1:
            found["ms, fastest run"] = lambda c, rows: _fastest_ms(_numbers(c, rows, "fit_s"))
    if "worst_over_bound" in columns:
        found["near"] = lambda c, rows: _percent(c["worst_over_bound"][_good(c, rows)] <= NEAR, rows)
    if "truth_ahead" in columns:
        found["S from the truth"] = lambda c, rows: _of_three(c, rows, "_over_bound_from_truth", _rms)
        found["near, from the truth"] = lambda c, rows: _percent(
            c["worst_over_bound_from_truth"][_good(c, rows)] <= NEAR, rows
        )
        found["same maximum"] = lambda c, rows: _percent(
            c["truth_ahead"][_good(c, rows)] <= SAME_MAXIMUM, rows
        )
    return found


def _good(columns: Columns, rows: Rows) -> Rows:
    return rows & (columns["status"] == "ok")


def _failures(columns: Columns, rows: Rows) -> str:
    bad = rows & (columns["status"] != "ok")
    if not bad.any():
        return "0"
    absent = np.count_nonzero(rows & (columns["status"] == "not_applicable"))
    return f"{np.count_nonzero(bad)}" + (" (does not apply)" if absent == np.count_nonzero(bad) else "")


def _numbers(columns: Columns, rows: Rows, name: str) -> np.ndarray:
    values = columns.get(name, np.full(len(rows), np.nan))[_good(columns, rows)].astype(float)
    return values[np.isfinite(values)]


def _of_three(columns: Columns, rows: Rows, suffix: str, say: Callable[[np.ndarray], str]) -> str:
    words = [say(_numbers(columns, rows, X + suffix)) for X in "MDK"]
    return " / ".join(words) if any(words) else ""


def _rms(values: np.ndarray) -> str:
    return _digits(float(np.sqrt(np.mean(values**2)))) if len(values) else ""


def _median_percent(values: np.ndarray) -> str:
    return f"{100 * np.median(values):.2g}" if len(values) else ""


def _fastest_ms(seconds: np.ndarray) -> str:
    """A busy machine slows the others."""
    return f"{1e3 * seconds.min():.3g}" if len(seconds) else ""


def _percent(true: np.ndarray, rows: Rows) -> str:
    """Of all runs: one without an estimate counts against it."""
    return f"{100 * np.count_nonzero(true) / max(np.count_nonzero(rows), 1):.0f} %"


def _digits(x: float) -> str:
    return f"{x:.2f}" if x < 10 else f"{x:.0f}" if x < 1e4 else f"{x:.0e}"


def main(arguments: Sequence[str]) -> int:
    """Writes the page; 2 where no study was run."""
    try:
        page = bound_page(arguments[0])
    except InputError as problem:
        print(problem, file=sys.stderr)
        return 2
    Path(arguments[1]).write_text(page)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
