"""The paired comparison: silent without a change, red for a small shift, whatever the scatter of the errors."""

from typing import Any

import numpy as np
import pytest

from sysid_bench.regress import compare_paired

LABELS = ["method", "sampling.h_s"]
POINTS, RUNS = 12, 100


def table(
    rng: np.random.Generator, shift: float = 1.0, point: int = 0, jitter: float = 0.0
) -> list[dict[str, Any]]:
    base = np.random.default_rng(1)
    rows = []
    for k in range(POINTS):
        errors = np.exp(base.normal(size=RUNS)) * (shift if k == point else 1.0)
        errors = errors * np.exp(jitter * rng.normal(size=RUNS))
        rows += [
            {"method": "m", "sampling.h_s": k / 10, "repetition": r, "status": "ok", "M_error": e}
            for r, e in enumerate(errors)
        ]
    return rows


def changes(rows: list[dict[str, Any]]) -> list[str]:
    reference = table(np.random.default_rng(0))
    return [f"{c.verdict} {c.cell['sampling.h_s']}" for c in compare_paired(rows, reference, LABELS)]


@pytest.mark.slow
def test_no_change_stays_green_over_200_reruns_with_rounding() -> None:
    red = [changes(table(np.random.default_rng(seed), jitter=1e-3)) for seed in range(200)]
    assert sum(map(bool, red)) == 0


@pytest.mark.parametrize(("shift", "verdict"), [(1.02, "worse"), (0.98, "better")])
def test_a_shift_of_two_percent_is_seen_where_it_is(shift: float, verdict: str) -> None:
    found = [changes(table(np.random.default_rng(seed), shift, point=3, jitter=0.02)) for seed in range(8)]
    assert sum(f == [f"{verdict} 0.3"] for f in found) >= 7


def test_a_significant_shift_below_the_practical_floor_is_no_news() -> None:
    assert changes(table(np.random.default_rng(0), 1.005)) == []


def test_failures_are_counted() -> None:
    rows = table(np.random.default_rng(0))
    for row in rows[:15]:
        row |= {"status": "diverged", "M_error": float("nan")}
    assert changes(rows) == ["worse 0"]


def test_a_missing_run_is_worse() -> None:
    assert changes(table(np.random.default_rng(0))[:-1]) == ["worse 1.1"]


def test_answers_in_place_of_refusals_count_where_they_are_sound() -> None:
    refused = table(np.random.default_rng(0))
    for row in refused[:15]:
        row |= {"status": "diverged", "M_error": float("nan")}
    for error, verdict in ((1.0, "better"), (50.0, "worse")):
        rows = table(np.random.default_rng(0))
        for row in rows[:15]:
            row["M_error"] = error
        assert [c.verdict for c in compare_paired(rows, refused, LABELS)] == [verdict]
