"""table -> its reference as text, and what is said of a number that changed."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid_bench.nouns import InputError

COMPARED = ("M_error", "D_error", "K_error", "A_error", "pole_error", "M_bound", "D_bound", "K_bound")


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


def name_of(row: Mapping[str, Any], labels: Sequence[str]) -> tuple[str, ...]:
    """What tells a cell (or a point, without repetition) from the others, as text."""
    return tuple(text_of(row.get(label)) for label in labels)


def text_of(value: Any) -> str:
    """A value as the reference writes it: ten significant digits, missing empty."""
    if value is None or value != value:
        return ""
    return f"{value:.10g}" if isinstance(value, float) else str(value)
