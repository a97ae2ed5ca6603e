"""The clock fit finds the clock, whatever the delays do."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sysid_bench.measure.arrivals import number_arrivals
from sysid_bench.measure.clock import fit_clock


def arrivals(drift_ppm: float, N: int = 5000, seed: int = 0, stalls: int = 5):
    rng = np.random.default_rng(seed)
    device = 0.002 * np.arange(N)
    delay = rng.exponential(3e-4, N)
    for start in rng.integers(0, N, stalls):  # the host was away: a burst of frames, all late
        away = slice(start, start + 40)
        delay[away] += 0.08 - 0.002 * np.arange(len(delay[away]))
    return device, 1e9 + 3.0 + (1 + 1e-6 * drift_ppm) * device + delay


@pytest.mark.parametrize("drift_ppm", [0.0, 40.0, -300.0])
def test_the_drift_is_found_under_stalls(drift_ppm: float) -> None:
    fit = fit_clock(*arrivals(drift_ppm))
    assert fit.drift_ppm == pytest.approx(drift_ppm, abs=max(5 * fit.drift_std_ppm, 1.0))
    assert fit.drift_std_ppm < 5.0
    assert fit.significant == (drift_ppm != 0.0)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_a_clock_that_does_not_drift_is_rarely_said_to(seed: int) -> None:
    fit = fit_clock(*arrivals(0.0, N=1500, seed=seed, stalls=3))
    assert abs(fit.drift_ppm) < 8 * fit.drift_std_ppm


def test_too_few_frames_give_no_fit() -> None:
    assert fit_clock(np.arange(10.0), np.arange(10.0)) is None


@pytest.mark.parametrize("jitter", [0.1, 0.4])
def test_arrivals_without_counters_are_numbered(jitter: float) -> None:
    rng = np.random.default_rng(4)
    k = np.delete(np.arange(1000), [200, 430, 431, 432, 800])
    host = 1e9 + 0.01 * (1 + 5e-5) * k + 0.01 * jitter * rng.random(len(k))
    numbers, period = number_arrivals(host, 0.01)
    assert period == pytest.approx(0.01 * (1 + 5e-5), rel=1e-4)
    assert numbers[-1] == 999
    assert np.count_nonzero(numbers != k) <= 8  # a gap may be placed a sample or two off


def test_a_host_that_was_away_loses_no_numbers() -> None:
    host = 1e9 + 0.01 * np.arange(500)
    host[100:115] = host[115]  # fifteen frames read at once
    numbers, _ = number_arrivals(host, 0.01)
    assert np.array_equal(numbers, np.arange(500))
