"""table, reference table -> which points got worse, by paired statistics over the same seeds: the second tier.

Per point and error: Wilcoxon's signed-rank test on the log-ratio of each seed's error to the reference's,
Benjamini-Hochberg over all tests, and a practical floor on the median ratio. Failures: an exact sign test on
the seeds whose status changed; an answer in place of a refusal, far worse than the answers of the point are, is a failure.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binom, binomtest, false_discovery_control, wilcoxon

from sysid_bench.regress.reference import ERRORS, Change, name_of, nonsense, tolerable_errors

FEWEST_PAIRS = 6


@dataclass(frozen=True)
class _Test:
    cell: Mapping[str, str]
    column: str
    p: float
    wanted: str
    got: str
    worse: bool
    matters: bool


def compare_paired(
    rows: Iterable[Mapping[str, Any]],
    reference: Iterable[Mapping[str, str]],
    labels: Sequence[str],
    level: float = 0.01,
    floor: float = 0.01,
) -> list[Change]:
    """Points that changed at false discovery rate `level` and by more than `floor` in the median log-ratio.

    `labels` name a point; "repetition" tells its seeds apart. A point or seed that is missing on one side is worse.
    """
    ours, theirs = _by_point(rows, labels), _by_point(reference, labels)
    changes, tests = [], []
    for name in dict.fromkeys([*theirs, *ours]):
        cell = dict(zip(labels, name))
        if set(ours.get(name, {})) != set(theirs.get(name, {})):
            counts = f"{len(theirs.get(name, {}))} runs", f"{len(ours.get(name, {}))} runs"
            changes.append(Change("worse", "cell", *counts, cell))
            continue
        tests += _tests(ours[name], theirs[name], cell, floor)
    return changes + _significant(tests, level)


def _by_point(
    rows: Iterable[Mapping[str, Any]], labels: Sequence[str]
) -> dict[Any, dict[str, Mapping[str, Any]]]:
    points: dict[Any, dict[str, Mapping[str, Any]]] = {}
    for row in rows:
        points.setdefault(name_of(row, labels), {})[str(row["repetition"])] = row
    return points


def _tests(
    ours: Mapping[str, Mapping[str, Any]],
    theirs: Mapping[str, Mapping[str, Any]],
    cell: Mapping[str, str],
    floor: float,
) -> Iterator[_Test]:
    seeds = list(theirs)
    yield from _status_test(*_answers(ours, theirs, seeds), cell)
    for column in ERRORS:
        ratios = np.array([_log_ratio(ours[s].get(column), theirs[s].get(column)) for s in seeds])
        ratios = ratios[np.isfinite(ratios)]
        if len(ratios) >= FEWEST_PAIRS and np.any(ratios):
            low, middle, high = median_interval(ratios)
            p = float(wilcoxon(ratios).pvalue)
            got = (
                f"x {np.exp(middle):.4g} (95 %: {np.exp(low):.4g} to {np.exp(high):.4g}, {len(ratios)} runs)"
            )
            yield _Test(cell, column, p, "reference", got, middle > 0, abs(middle) > floor)


def _answers(
    ours: Mapping[str, Mapping[str, Any]], theirs: Mapping[str, Mapping[str, Any]], seeds: Sequence[str]
) -> tuple[list[bool], list[bool]]:
    """Per seed: was there an answer, is there one. A new one that is nonsense makes the old refusal an answer."""
    before = [theirs[s]["status"] == "ok" for s in seeds]
    now = [ours[s]["status"] == "ok" for s in seeds]
    tolerable = tolerable_errors(theirs.values())
    wrong = [n and not b and bool(nonsense(ours[s], tolerable)) for s, b, n in zip(seeds, before, now)]
    return [b or w for b, w in zip(before, wrong)], [n and not w for n, w in zip(now, wrong)]


def _log_ratio(got: Any, wanted: Any) -> float:
    try:
        got, wanted = float(got), float(wanted)
    except (TypeError, ValueError):
        return float("nan")
    return float(np.log(got / wanted)) if got > 0 and wanted > 0 else float("nan")


def _status_test(before: list[bool], now: list[bool], cell: Mapping[str, str]) -> Iterator[_Test]:
    lost = sum(b and not n for b, n in zip(before, now))
    won = sum(n and not b for b, n in zip(before, now))
    if lost + won:
        p = float(binomtest(lost, lost + won, 0.5).pvalue)
        counts = f"{before.count(False)} failures or refusals of {len(before)}", f"{now.count(False)}"
        yield _Test(cell, "status", p, *counts, worse=lost > won, matters=True)


def median_interval(values: np.ndarray, confidence: float = 0.95) -> tuple[float, float, float]:
    """(low, median, high): distribution-free interval of the median by order statistics."""
    ordered = np.sort(values)
    k = int(binom.ppf((1 - confidence) / 2, len(values), 0.5))
    return (
        float(ordered[max(k - 1, 0)]),
        float(np.median(ordered)),
        float(ordered[min(len(values) - k, len(values) - 1)]),
    )


def _significant(tests: list[_Test], level: float) -> list[Change]:
    if not tests:
        return []
    adjusted = false_discovery_control([test.p for test in tests])
    return [
        Change("worse" if t.worse else "better", t.column, t.wanted, f"{t.got}, p = {q:.1e}", t.cell)
        for t, q in zip(tests, adjusted)
        if q < level and t.matters
    ]
