"""table, reference table -> better, same, worse per cell, with the numbers behind it."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid_bench.nouns import InputError

COMPARED = ("M_error", "D_error", "K_error", "A_error", "pole_error", "M_bound", "D_bound", "K_bound")
SEVERITY = {"ok": 0, "not_applicable": 1, "diverged": 2, "timeout": 3, "error": 4}


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


def reference_rows(rows: Iterable[Mapping[str, Any]], labels: Sequence[str]) -> list[dict[str, Any]]:
    """What of a table is kept as its reference: labels, status and the compared numbers."""
    return [{name: row.get(name) for name in (*labels, "status", *COMPARED)} for row in rows]


def read_reference(path: Path) -> list[dict[str, str]]:
    """Rows of a reference table (CSV text). Raises InputError where there is none."""
    if not path.is_file():
        raise InputError(f"{path}: no reference table; make it with `sysid-bench check accept=true`.")
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def compare_exact(
    rows: Iterable[Mapping[str, Any]],
    reference: Iterable[Mapping[str, str]],
    labels: Sequence[str],
    rtol: float,
) -> list[Change]:
    """Cell by cell at the same seeds: the status, and each number to `rtol` relative (atol = 0).

    A cell that the reference has and the table has not, or the other way round, is worse: a silent loss.
    """
    ours = {_name(row, labels): row for row in rows}
    theirs = {_name(row, labels): row for row in reference}
    changes = []
    for name in dict.fromkeys([*theirs, *ours]):
        cell = dict(zip(labels, name))
        if name not in ours or name not in theirs:
            there = ("present", "missing") if name not in ours else ("missing", "present")
            changes.append(Change("worse", "cell", *there, cell))
            continue
        changes += _cell_changes(ours[name], theirs[name], cell, rtol)
    return changes


def _name(row: Mapping[str, Any], labels: Sequence[str]) -> tuple[str, ...]:
    return tuple(text_of(row.get(label)) for label in labels)


def text_of(value: Any) -> str:
    """A value as the reference writes it: ten significant digits, missing empty."""
    if value is None or value != value:
        return ""
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def _cell_changes(
    row: Mapping[str, Any], reference: Mapping[str, str], cell: Mapping[str, str], rtol: float
) -> list[Change]:
    before, now = reference["status"], str(row["status"])
    if before != now:
        verdict = "better" if SEVERITY.get(now, 9) < SEVERITY.get(before, 9) else "worse"
        return [Change(verdict, "status", before, f"{now} {row.get('reason') or ''}".strip(), cell)]
    changes = []
    for column in COMPARED:
        wanted, got = reference.get(column, ""), text_of(row.get(column))
        if wanted != got and not _close(wanted, got, rtol):
            changes.append(Change(_direction(wanted, got), column, wanted or "none", got or "none", cell))
    return changes


def _close(wanted: str, got: str, rtol: float) -> bool:
    return bool(wanted and got) and abs(float(got) - float(wanted)) <= rtol * abs(float(wanted))


def _direction(wanted: str, got: str) -> str:
    return "better" if wanted and got and float(got) < float(wanted) else "worse"
