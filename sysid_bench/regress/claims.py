"""table of fresh seeds, claims -> which claims do not hold, each with its interval: the third tier.

A claim is about methods, not about cells: a ratio of errors, a slope against h, a failure rate, the rms of an
error over its Cramer-Rao bound. It holds where the whole interval lies within its limits (for a ratio this is
the two one-sided tests of equivalence, or an order of two methods where one limit is 1).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.stats import binomtest, bootstrap

from sysid_bench.nouns import Array, InputError
from sysid_bench.regress.paired import median_interval
from sysid_bench.regress.reference import Change

KINDS = ("ratio", "slope", "failures", "bound")
CONFIDENCE = 0.99
RESAMPLES = 4999


@dataclass(frozen=True)
class Claim:
    """kind of number, within limits, for the rows `where`.

    ratio     median over seeds of methods[0]'s column over methods[1]'s, paired
    slope     of the log of the median column against the log of `against`
    failures  share of runs of methods[0] that are not ok
    bound     rms of the column (an error over its bound)
    """

    says: str
    kind: str
    methods: Sequence[str]
    limits: Sequence[float]
    column: str = "K_error"
    against: str = "sampling.h_s"
    where: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"a claim's kind must be one of {', '.join(KINDS)}; got {self.kind!r}.")
        wanted = 2 if self.kind == "ratio" else 1
        if len(self.methods) != wanted or len(self.limits) != 2:
            raise InputError(f"claim {self.says!r}: a {self.kind} needs {wanted} method(s) and two limits.")


@dataclass(frozen=True)
class Measured:
    """A claim's number with its interval at 99 % confidence, from `runs` runs."""

    claim: Claim
    value: float
    low: float
    high: float
    runs: int

    @property
    def holds(self) -> bool:
        return self.claim.limits[0] <= self.low and self.high <= self.claim.limits[1]

    def __str__(self) -> str:
        low, high = self.claim.limits
        return (
            f"{self.claim.says}: {self.value:.4g} (99 %: {self.low:.4g} to {self.high:.4g}, {self.runs} runs); "
            f"claimed {low:g} to {high:g}"
        )

    def row(self) -> dict[str, Any]:
        """As the reference keeps it."""
        numbers = {"value": self.value, "low": self.low, "high": self.high, "runs": self.runs}
        return {"claim": self.claim.says, "kind": self.claim.kind} | numbers


def measure(claim: Claim, rows: Iterable[Mapping[str, Any]], rng: np.random.Generator) -> Measured:
    """The number that a claim is about. Raises InputError where the table has no row for it."""
    chosen = [r for r in rows if all(r.get(key) == value for key, value in claim.where.items())]
    per_method = [[r for r in chosen if r["method"] == name] for name in claim.methods]
    if not all(per_method):
        raise InputError(f"claim {claim.says!r}: the study has no rows for it.")
    value, low, high = _KINDS[claim.kind](claim, per_method, rng)
    return Measured(claim, float(value), float(low), float(high), len(per_method[0]))


def judge(measured: Sequence[Measured], accepted: Sequence[Mapping[str, str]]) -> list[Change]:
    """Worse: claims that do not hold, or whose interval lies above the accepted one; better: below it.

    A slope is better nowhere; claims without an accepted number are judged by their limits alone.
    """
    known = {row["claim"]: row for row in accepted}
    changes = []
    for m in measured:
        cell = {"claim": m.claim.says}
        before = known.get(m.claim.says)
        if not m.holds:
            changes.append(Change("worse", m.claim.kind, "holds", f"does not hold: {m}", cell))
        elif before and m.claim.kind != "slope" and m.low > float(before["high"]):
            changes.append(Change("worse", m.claim.kind, f"{before['value']}", str(m), cell))
        elif before and m.claim.kind != "slope" and m.high < float(before["low"]):
            changes.append(Change("better", m.claim.kind, f"{before['value']}", str(m), cell))
    return changes


def _ratio(claim: Claim, rows: list[list[Any]], rng: np.random.Generator) -> tuple[float, float, float]:
    one, other = (_by_seed(claim, r) for r in rows)
    logs = np.log([one[seed] / other[seed] for seed in one if seed in other])
    if len(logs) == 0:
        return np.nan, -np.inf, np.inf
    low, middle, high = np.exp(median_interval(logs, CONFIDENCE))
    return middle, low, high


def _by_seed(claim: Claim, rows: list[Any]) -> dict[Any, float]:
    """seed -> the column, of the runs that are ok."""
    found = {row["seed"]: row.get(claim.column) for row in rows if row["status"] == "ok"}
    return {seed: value for seed, value in found.items() if value is not None and value > 0}


def _slope(claim: Claim, rows: list[list[Any]], rng: np.random.Generator) -> tuple[float, float, float]:
    points: dict[float, list[float]] = {}
    for row in rows[0]:
        if row["status"] == "ok":
            points.setdefault(row[claim.against], []).append(row[claim.column])
    x = np.log(list(points))
    draws = [_resampled_medians(np.asarray(values), rng) for values in points.values()]
    slopes = np.polyfit(x, np.log(np.array(draws)), 1)[0]
    value = np.polyfit(x, np.log([np.median(values) for values in points.values()]), 1)[0]
    low, high = np.quantile(slopes, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(value), float(low), float(high)


def _resampled_medians(values: Array, rng: np.random.Generator) -> Array:
    """(RESAMPLES,) medians of bootstrap samples."""
    return np.median(values[rng.integers(len(values), size=(RESAMPLES, len(values)))], axis=1)


def _failures(claim: Claim, rows: list[list[Any]], rng: np.random.Generator) -> tuple[float, float, float]:
    failed = sum(row["status"] != "ok" for row in rows[0])
    interval = binomtest(failed, len(rows[0])).proportion_ci(CONFIDENCE, method="exact")
    return failed / len(rows[0]), interval.low, interval.high


def _bound(claim: Claim, rows: list[list[Any]], rng: np.random.Generator) -> tuple[float, float, float]:
    squares = np.array([row[claim.column] for row in rows[0] if row["status"] == "ok"]) ** 2
    found = bootstrap(
        (squares,), np.mean, confidence_level=CONFIDENCE, n_resamples=RESAMPLES, method="BCa", rng=rng
    )
    interval = found.confidence_interval
    low, middle, high = np.sqrt([interval.low, squares.mean(), interval.high])
    return middle, low, high


_KINDS = {"ratio": _ratio, "slope": _slope, "failures": _failures, "bound": _bound}
