"""The noise floor and the steps that the gap workflow judges by, and records of accelerations."""

from __future__ import annotations

import numpy as np
import pytest

from sysid_bench.effects import effect_class, names
from sysid_bench.gap.check_data import check_data
from sysid_bench.gap.decide import _too_much
from sysid_bench.gap.descent import fit
from sysid_bench.gap.fineness import finer
from sysid_bench.gap.prepare import lower_floor, prepared
from sysid_bench.gap.problem import Point
from sysid_bench.gap.refit import linear_fit
from sysid_bench.gap.screen import screen
from sysid_bench.gap.thresholds import Thresholds
from sysid_bench.gap.traces import _filled_input, noise_floor, trace_of
from sysid_bench.mechanics.nonlinear import simulate
from sysid_bench.nouns import Model, Record

CUBIC = effect_class("cubic_stiffness")


def hardening(samples_per_period=12.0, noise=0.01, cubic=40.0, output="displacement", seed=0):
    """A problem whose truth has a cubic spring; the truth's effect, the data check and the noise's variance."""
    rng = np.random.default_rng(seed)
    h = 2 * np.pi / np.sqrt(40.0) / samples_per_period
    u = np.repeat(rng.choice([-4.0, 4.0], 500), 4)[:, None]
    effect = CUBIC(0, cubic)
    model = Model(
        np.eye(1), np.array([[0.6]]), np.array([[40.0]]), np.eye(1), np.eye(1), output=output, hold="zoh"
    )
    truth = Model(
        np.eye(1),
        np.array([[0.6]]),
        np.array([[40.0]]),
        np.eye(1),
        np.eye(1),
        output=output,
        effects=(effect,),
    )
    y = simulate(truth, u, h, "zoh", substeps=60).y
    sd = noise * y.std()
    record = Record(h * np.arange(len(u)), u, y + sd * rng.standard_normal(y.shape), hold="zoh")
    check = check_data([record])
    return prepared([record], model, check)[0], effect, check, sd**2


def test_a_record_that_does_not_end_where_it_began_leaks_nothing_into_the_floor():
    t = 0.05 * np.arange(3000)
    noise = 1e-3 * np.random.default_rng(1).standard_normal(len(t))
    y = (np.exp(-0.01 * t) * np.cos(2 * t) + noise)[:, None]
    model = Model(np.eye(1), np.eye(1), np.eye(1), np.eye(1), np.eye(1), hold="zoh")
    trace = trace_of(Record(t, np.zeros((len(t), 1)), y, hold="zoh"), model)
    assert noise_floor(trace, y, np.zeros(1)).variance[0] == pytest.approx(1e-6, rel=0.15)


def test_the_floor_falls_to_what_the_right_fit_leaves():
    problem, effect, check, variance = hardening(samples_per_period=7, noise=3e-3)
    assert problem.traces[0].variance[0] > 1.5 * variance  # the motion fills the highest frequencies
    fine = finer(problem, Point(np.zeros(3), (effect,), (np.zeros(2),)))
    found = fit(fine, Point(np.zeros(3), (effect,), (np.zeros(2),)), ((0, 0),))
    lower = lower_floor(fine, found, check)
    assert lower is not None and lower.traces[0].variance[0] == pytest.approx(variance, rel=0.15)
    assert lower_floor(lower, found, check) is None


def test_steps_are_halved_where_the_integration_is_heard_above_the_noise():
    coarse, effect, _, _ = hardening(samples_per_period=7, noise=3e-3)
    loud, _, _, _ = hardening(samples_per_period=7, noise=0.3)
    point = Point(np.zeros(3), (effect,), (np.zeros(2),))
    assert finer(coarse, point).fineness > 1
    assert finer(loud, point).fineness == 1


@pytest.mark.parametrize("output", ["velocity", "acceleration"])
def test_a_strong_effect_is_seen_in_velocities_and_accelerations(output):
    problem, _, _, _ = hardening(cubic=200.0, output=output)
    linear = linear_fit(problem)
    assert linear is not None and linear.rho > 3
    first = screen(problem, linear, [effect_class(name) for name in names()]).candidates[0]
    assert first.effect.name == "cubic_stiffness"


@pytest.mark.parametrize(
    ("rho", "left", "too_much"),
    [(1.2, 0.47, True), (1.2, 0.05, False), (1.05, 0.6, False), (1.6, 0.06, True), (40.0, 0.01, False)],
)
def test_an_effect_that_takes_only_part_of_the_gap_is_not_its_name(rho, left, too_much):
    assert _too_much(rho, left, False, Thresholds()) is too_much


def test_a_smooth_input_is_filled_by_a_curve_that_does_not_overshoot():
    """Two in a hundred samples lost, 20 per period at 1.6 rad/s of a band-limited input: a third of a straight line's error."""
    rng, t = np.random.default_rng(0), 0.2 * np.arange(4000)
    waves = zip(rng.uniform(0.1, 1.6, 30), rng.uniform(0, 6, 30))
    u = sum(np.sin(omega * t + phase) for omega, phase in waves)[:, None]
    good = rng.random(len(u)) > 0.02
    error = {hold: np.std((_filled_input(u, good, hold) - u)[~good]) for hold in ("cubic", "foh")}
    assert error["cubic"] < error["foh"] / 3
    good = np.ones(len(u), dtype=bool)
    good[1000:1040] = good[0] = good[-1] = False
    filled = _filled_input(u, good, "cubic")
    assert np.isfinite(filled).all() and np.abs(filled).max() <= 1.01 * np.abs(u).max()
