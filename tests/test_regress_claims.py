"""Claims on fresh seeds: the number, its interval, and when the claim holds."""

from typing import Any

import numpy as np
import pytest

from sysid_bench.nouns import InputError
from sysid_bench.regress import Claim, judge, measure

RUNS = 200


def rows(method: str, level: float, slope: float = 0.0, failures: int = 0) -> list[dict[str, Any]]:
    """Errors level * h^slope with log-normal scatter, the same at the same seed for all methods."""
    found = []
    for h in (0.1, 0.2, 0.4):
        scatter = np.exp(np.random.default_rng(1).normal(size=RUNS))
        for seed in range(RUNS):
            status = "diverged" if seed < failures else "ok"
            error = None if status != "ok" else float(level * h**slope * scatter[seed])
            found.append(
                {"method": method, "sampling.h_s": h, "seed": (h, seed), "status": status, "K_error": error}
            )
    return found


def measured(claim: Claim, *tables: list[dict[str, Any]]) -> Any:
    return measure(claim, [row for table in tables for row in table], np.random.default_rng(0))


def test_a_ratio_is_paired_and_equivalence_needs_the_whole_interval() -> None:
    found = measured(Claim("x", "ratio", ["a", "b"], [0.95, 1.05]), rows("a", 1.02), rows("b", 1.0))
    assert found.value == pytest.approx(1.02) and found.low == pytest.approx(1.02) and found.holds
    assert not measured(Claim("x", "ratio", ["a", "b"], [0.95, 1.01]), rows("a", 1.02), rows("b", 1.0)).holds


def test_a_slope_is_that_of_the_medians() -> None:
    found = measured(Claim("x", "slope", ["a"], [1.5, 2.5]), rows("a", 1.0, slope=2.0))
    assert found.value == pytest.approx(2.0) and found.low < 2.0 < found.high and found.high - found.low < 1.0


def test_a_failure_rate_has_the_exact_binomial_interval() -> None:
    found = measured(Claim("x", "failures", ["a"], [0.0, 0.1]), rows("a", 1.0, failures=10))
    assert found.value == 0.05 and 0.02 < found.low < 0.05 < found.high < 0.1 and found.holds


def test_the_bound_is_met_in_the_rms_with_the_promised_coverage() -> None:
    inside = 0
    for seed in range(100):
        normal = np.random.default_rng(seed).normal(size=60)
        table = [{"method": "a", "status": "ok", "K_error": abs(x)} for x in normal]
        inside += (m := measured(Claim("x", "bound", ["a"], [0.5, 1.5]), table)).low <= 1.0 <= m.high
    assert inside >= 94


def test_worse_is_what_does_not_hold_or_lies_above_the_accepted_interval() -> None:
    claim = Claim("x", "failures", ["a"], [0.0, 0.9])
    few, many = (measured(claim, rows("a", 1.0, failures=k)) for k in (2, 150))
    accepted = [{key: str(value) for key, value in few.row().items()}]
    assert judge([few], accepted) == [] and [c.verdict for c in judge([many], accepted)] == ["worse"]
    accepted = [{key: str(value) for key, value in many.row().items()}]
    assert [c.verdict for c in judge([few], accepted)] == ["better"]
    strict = Claim("x", "failures", ["a"], [0.0, 0.1])
    assert [c.verdict for c in judge([measured(strict, rows("a", 1.0, failures=150))], [])] == ["worse"]


def test_a_claim_about_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="no rows"):
        measured(Claim("x", "slope", ["z"], [0, 1]), rows("a", 1.0))
    with pytest.raises(InputError, match="2 method"):
        Claim("x", "ratio", ["a"], [0, 1])
    with pytest.raises(InputError, match="kind"):
        Claim("x", "guess", ["a"], [0, 1])
