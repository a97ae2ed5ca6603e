"""Times, flags and verdict of a run, from what the log holds."""

import numpy as np
import pytest

from sysid_bench.measure.judge import Rules, judged
from sysid_bench.nouns import LATE, LOST, STUCK

RULES = Rules(500.0, 1e-6, True, late_s=0.1, max_lost=0.01, max_drift_ppm=1000.0, stuck_s=0.25)
N = 4000


def columns(drift_ppm: float = 0.0, jitter_ticks: int = 0, seed: int = 1) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    tick = 7_000_000 + 2000 * np.arange(N) + rng.integers(-jitter_ticks, jitter_ticks + 1, N)
    host = 1.7e9 + 1e-6 * tick * (1 + 1e-6 * drift_ppm) + rng.exponential(2e-4, N)
    y = rng.standard_normal(N)
    return {
        "t": 0.002 * np.arange(N), "u1": y, "y1": y, "quality": np.zeros(N), "k": 250 + np.arange(N), "tick": tick,
        "host_s": host,
    }  # fmt: skip


def test_regular_ticks_give_exactly_even_times() -> None:
    table, verdict = judged(columns(), RULES, {})
    assert verdict.valid and not verdict.clock.significant
    assert np.allclose(table["t"], 0.002 * np.arange(N), rtol=1e-12, atol=1e-12)


def test_drift_stretches_the_times() -> None:
    table, verdict = judged(columns(drift_ppm=80.0), RULES, {})
    assert verdict.clock.significant and verdict.clock.drift_ppm == pytest.approx(80.0, abs=3.0)
    assert table["t"][-1] == pytest.approx(0.002 * (N - 1) * (1 + 80e-6), rel=3e-6)


def test_sampling_jitter_is_in_the_times() -> None:
    given = columns(jitter_ticks=200)
    table, verdict = judged(given, RULES, {})
    assert verdict.valid
    assert np.allclose(np.diff(table["t"]), 1e-6 * np.diff(given["tick"]), atol=1e-12)


def test_clocks_that_differ_too_much_make_a_record_invalid_and_leave_its_times() -> None:
    table, verdict = judged(columns(drift_ppm=30_000.0), RULES, {})
    assert not verdict.valid and "ppm" in verdict.reason
    assert verdict.as_origin()["clock"]["applied"] is False
    assert table["t"][1] == pytest.approx(0.002, rel=1e-9)


def test_late_and_stuck_samples_are_flagged_afterwards() -> None:
    given = columns()
    given["host_s"][100:110] += 0.2
    given["y1"][1000:1200] = 0.5  # 0.4 s
    given["y1"][2000:2050] = 0.5  # 0.1 s
    table, verdict = judged(given, RULES, {})
    assert np.flatnonzero(table["quality"] & LATE).tolist() == list(range(100, 110))
    assert np.flatnonzero(table["quality"] & STUCK).tolist() == list(range(1000, 1200))
    assert verdict.counts["late"] == 10 and verdict.counts["stuck"] == 200


@pytest.mark.parametrize(("lost", "valid"), [(40, True), (41, False)])
def test_more_than_one_percent_lost_makes_a_record_invalid(lost: int, valid: bool) -> None:
    given = columns()
    for name in ("y1", "host_s"):
        given[name][500 : 500 + lost] = np.nan
    given["quality"][500 : 500 + lost] = LOST
    given["tick"][500 : 500 + lost] = -1
    table, verdict = judged(given, RULES, {})
    assert verdict.valid is valid and verdict.lost_share == lost / N
    assert np.allclose(table["t"], 0.002 * np.arange(N), atol=1e-12)  # a lost sample still has its time


def test_forces_not_known_for_certain_make_a_record_invalid() -> None:
    _, verdict = judged(columns(), RULES, {"forces_uncertain": 1})
    assert not verdict.valid and "not known for certain" in verdict.reason
