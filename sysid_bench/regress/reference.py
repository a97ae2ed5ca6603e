"""table -> its reference as text, and what is said of a number that changed."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench.nouns import InputError

ERRORS = ("M_error", "D_error", "K_error", "A_error", "pole_error")
COMPARED = (*ERRORS, "M_bound", "D_bound", "K_bound")
HOPELESS = 1.0  # a relative error of 100 % answers nothing
SPREAD = 3.0  # times the median: about 2 % of sound answers are worse


@dataclass(frozen=True)
class Change:
    """One number or status of one cell that is not what the reference says.

    verdict "worse" or "better"; wanted and got as text; cell: label -> value.
    """

    verdict: str
    column: str
    wanted: str
    got: str
    cell: Mapping[str, Any]

    def __str__(self) -> str:
        where = " ".join(f"{key}={value}" for key, value in self.cell.items())
        return f"{self.verdict}: {self.column} {self.wanted} -> {self.got}   [{where}]"


def reference_rows(
    rows: Iterable[Mapping[str, Any]], labels: Sequence[str], columns: Sequence[str] = COMPARED
) -> list[dict[str, Any]]:
    """What of a table is kept as its reference: labels, status and the compared numbers."""
    return [{name: row.get(name) for name in (*labels, "status", *columns)} for row in rows]


def medians(rows: Iterable[Mapping[str, Any]], labels: Sequence[str]) -> list[dict[str, Any]]:
    """A table for people and diffs: per point its runs, how many are not ok, and the median of each error."""
    points: dict[tuple[str, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        points.setdefault(name_of(row, labels), []).append(row)
    return [dict(zip(labels, name)) | _medians(members) for name, members in points.items()]


def _medians(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    ok = [row for row in rows if row["status"] == "ok"]
    found: dict[str, Any] = {"runs": len(rows), "not_ok": len(rows) - len(ok)}
    for name in ERRORS:
        values = [number(row.get(name)) for row in ok]
        known = [value for value in values if np.isfinite(value)]
        found[name] = float(np.median(known)) if known else None
    return found


def read_reference(path: Path) -> list[dict[str, str]]:
    """Rows of a reference table (CSV text). Raises InputError where there is none."""
    if not path.is_file():
        raise InputError(f"{path}: no reference table; make it with `sysid-bench check accept=true`.")
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def part_of(rows: Iterable[Mapping[str, str]], only: Mapping[str, str]) -> list[Mapping[str, str]]:
    """The rows of a reference whose labels are as `only` says (those labels that the reference has)."""
    return [r for r in rows if all(_same(r[key], value) for key, value in only.items() if key in r)]


def _same(label: str, wanted: str) -> bool:
    try:
        return float(label) == float(wanted)
    except ValueError:
        return label == wanted


def name_of(row: Mapping[str, Any], labels: Sequence[str]) -> tuple[str, ...]:
    """What tells a cell (or a point, without repetition) from the others, as text."""
    return tuple(text_of(row.get(label)) for label in labels)


def text_of(value: Any) -> str:
    """A value as the reference writes it: ten significant digits, missing empty."""
    if value is None or value != value:
        return ""
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def tolerable_errors(rows: Iterable[Mapping[str, Any]]) -> dict[str, float]:
    """Error -> three times its median among the rows that are ok; HOPELESS where there is none."""
    found = _medians(list(rows))
    return {name: HOPELESS if found[name] is None else SPREAD * found[name] for name in ERRORS}


def nonsense(row: Mapping[str, Any], tolerable: Mapping[str, float]) -> str:
    """The first error of a row that is above the tolerable one, as text; empty where there is none."""
    found = ((name, number(row.get(name))) for name in ERRORS)
    return next((f"{name} {value:.4g}" for name, value in found if value > tolerable[name]), "")


def number(value: Any) -> float:
    """A number of a table or of a reference's text; missing: -inf, which is above nothing."""
    try:
        return -np.inf if value is None or np.isnan(float(value)) else float(value)
    except ValueError:
        return -np.inf
