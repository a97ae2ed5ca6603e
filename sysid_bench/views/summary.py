"""table -> summary rows for people: medians, quantiles, rms, ratio to the bound, runs and failures; never a bare mean."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid_bench.table import groups_of
from sysid_bench.views.study import OPTIONS, Study, failed

ERRORS = ("M_error", "D_error", "K_error", "A_error", "pole_error")
NUMBER = re.compile(r"-?\d+(\.\d+)?(e[+-]?\d+)?")
NO_NUMBERS = (
    "repetition",
    "seed",
    "nominal",
    "fit_s",
    "seconds",
    "sampling.h_s",
    "sampling.N",
    "noise.snr_db",
)


@dataclass(frozen=True)
class Number:
    """One column over the runs of one group: median, low (10 %), high (90 %), rms, and the rms of its ratio
    to the Cramér-Rao bound (NaN where there is no bound)."""

    median: float
    low: float
    high: float
    rms: float
    over_bound: float


@dataclass(frozen=True)
class Group:
    """Rows of one combination of axes: its values, runs, failures, and a Number per column."""

    values: tuple[Any, ...]
    runs: int
    failures: int
    not_applicable: int
    seconds: float
    numbers: tuple[Number, ...]


def measured_columns(study: Study) -> list[str]:
    """Columns to summarise: the errors; coefficients that have a theory; for an analysis all it returned."""
    errors = [c for c in ERRORS if _has_numbers(study, c)]
    coefficients = [
        c.removesuffix("_theory") for c in study.columns if c.endswith("_theory") and _has_numbers(study, c)
    ]
    if errors or coefficients:
        return [*errors, *(c for c in coefficients if c in study.columns)]
    skip = {*NO_NUMBERS, *OPTIONS, *study.axes}
    return [
        c for c in study.columns if c not in skip and not c.startswith("diag.") and _has_numbers(study, c)
    ]


def _has_numbers(study: Study, column: str) -> bool:
    values = study.columns.get(column)
    return values is not None and values.dtype.kind in "fiu" and bool(np.isfinite(values).any())


def summarise(study: Study) -> list[Group]:
    """One Group per combination of the study's axes, in the order of the axes."""
    axes, measured = study.axes or ("method",), measured_columns(study)
    axes = tuple(a for a in axes if a in study.columns)
    ranks = [{value: i for i, value in enumerate(study.order(a))} for a in axes]
    found = (
        [(tuple(labels.values()), rows) for labels, rows in groups_of(study.columns, axes)]
        if axes
        else [((), np.arange(study.rows))]
    )
    found.sort(key=lambda group: [rank.get(v, -1) for v, rank in zip(group[0], ranks)])
    return [_group(study, values, rows, measured) for values, rows in found]


def _group(study: Study, values: tuple, rows: np.ndarray, measured: Sequence[str]) -> Group:
    status = study.columns["status"][rows]
    ok = rows[status == "ok"]
    seconds = study.columns.get("fit_s", study.columns.get("seconds", np.full(study.rows, np.nan)))[ok]
    return Group(
        values, len(rows), int(failed(study.columns)[rows].sum()), int((status == "not_applicable").sum()),
        float(np.median(seconds)) if len(seconds) else np.nan, tuple(_number(study, c, ok) for c in measured),
    )  # fmt: skip


def _number(study: Study, column: str, rows: np.ndarray) -> Number:
    values = study.columns[column][rows]
    good = np.isfinite(values)
    if not good.any():
        return Number(*[np.nan] * 5)
    low, median, high = np.quantile(values[good], (0.1, 0.5, 0.9))
    bound = study.columns.get(column.removesuffix("_error") + "_bound") if column in ERRORS else None
    ratio = np.full(1, np.nan) if bound is None else values[good] / bound[rows][good]
    return Number(median, low, high, _rms(values[good]), _rms(ratio))


def _rms(values: np.ndarray) -> float:
    largest = np.abs(values).max()  # scaled: squares of what diverged overflow
    return float(largest * np.sqrt(np.mean((values / largest) ** 2))) if largest != 0 else 0.0


def failures(study: Study) -> list[tuple[str, str, str, int, float, str]]:
    """Rows without an estimate, most frequent first: method, status, reason, count, share of the method's
    runs, one example (the axes' values of its first row). Reasons that differ in numbers alone are one."""
    who = study.columns.get("method", study.columns.get("analysis", np.full(study.rows, "", dtype=object)))
    found: dict[tuple[str, str, str], list[int]] = {}
    for i in np.flatnonzero(study.columns["status"] != "ok"):
        kind = (
            str(who[i]),
            str(study.columns["status"][i]),
            NUMBER.sub("#", str(study.columns["reason"][i])),
        )
        found.setdefault(kind, []).append(int(i))
    total = Counter(str(w) for w in who)
    return [
        (
            *kind[:2],
            _short(str(study.columns["reason"][rows[0]])),
            len(rows),
            len(rows) / total[kind[0]],
            cell_words(study, rows[0]),
        )
        for kind, rows in sorted(found.items(), key=lambda item: -len(item[1]))
    ]


def _short(reason: str) -> str:
    line = (reason.strip().splitlines() or [""])[0]
    return line if len(line) <= 220 else line[:217] + "..."


def cell_words(study: Study, row: int) -> str:
    """One row by its axes: `plant=three_dof sampling.h_s=0.1 repetition=3`."""
    keys = [
        k
        for k in (*study.axes, "repetition")
        if k in study.columns and study.columns[k][row] == study.columns[k][row]
    ]
    return " ".join(f"{k}={plain(study.columns[k][row])}" for k in keys)


def plain(value: Any) -> str:
    """A table value in few characters: 0.00512, three_dof, 12."""
    if value is None or value != value:
        return "-"
    return f"{value:.4g}" if isinstance(value, float | np.floating) else str(value)
