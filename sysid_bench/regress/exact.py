"""table, reference table -> better, same, worse per cell, at the same seeds: the first tier."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from sysid_bench.regress.reference import COMPARED, Change, name_of, text_of

SEVERITY = {"ok": 0, "not_applicable": 1, "diverged": 2, "timeout": 3, "error": 4}
REFUSALS = ("not_applicable", "diverged")


def compare_exact(
    rows: Iterable[Mapping[str, Any]],
    reference: Iterable[Mapping[str, str]],
    labels: Sequence[str],
    rtol: float,
) -> list[Change]:
    """Cell by cell at the same seeds: the status, and each number to `rtol` relative (atol = 0).

    A cell that the reference has and the table has not, or the other way round, is worse: a silent loss. So is an
    answer in place of an honest refusal (diverged, not_applicable): it may be a silent fallback, and only a person
    can tell; the paired tier weighs it.
    """
    ours = {name_of(row, labels): row for row in rows}
    theirs = {name_of(row, labels): row for row in reference}
    changes = []
    for name in dict.fromkeys([*theirs, *ours]):
        cell = dict(zip(labels, name))
        if name not in ours or name not in theirs:
            there = ("present", "missing") if name not in ours else ("missing", "present")
            changes.append(Change("worse", "cell", *there, cell))
        elif theirs[name]["status"] != str(ours[name]["status"]):
            changes.append(_status_change(ours[name], theirs[name], cell))
        else:
            changes += _number_changes(ours[name], theirs[name], cell, rtol)
    return changes


def _status_change(row: Mapping[str, Any], reference: Mapping[str, str], cell: Mapping[str, str]) -> Change:
    before, now = reference["status"], str(row["status"])
    if now == "ok" and before in REFUSALS:
        return Change(
            "worse", "status", before, "ok: answers where it refused; accept=true if that is right", cell
        )
    verdict = "better" if SEVERITY.get(now, 9) < SEVERITY.get(before, 9) else "worse"
    return Change(verdict, "status", before, f"{now} {row.get('reason') or ''}".strip(), cell)


def _number_changes(
    row: Mapping[str, Any], reference: Mapping[str, str], cell: Mapping[str, str], rtol: float
) -> list[Change]:
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
