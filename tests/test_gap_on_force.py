"""Closed loop and free masses: the gap on the force names what the position cannot tell. Simulated by a loop of its own."""

import sys
from pathlib import Path

import numpy as np
import pytest

from sysid_bench.gap.held_out import is_sure
from sysid_bench.gap.workflow import find_gap
from sysid_bench.nouns import Model, Record
from sysid_bench.views import gap_figures

STUDY = Path(__file__).parent.parent / "experiments" / "measured_machines"
sys.path.insert(0, str(STUDY))
from closed_loop import DAMPING, FINE, MASS, PITCH, H, closed_loop  # noqa: E402

sys.path.remove(str(STUDY))


@pytest.fixture(scope="module")
def machine():
    """Two records to learn from and one to prove on, each with a phase of its own."""
    rng = np.random.default_rng(7)
    lacking = dict(coulomb=20.0, asymmetry=-37.0, ripple=2.0, delay=1)
    return [
        closed_loop(rng, phase=0.4, **lacking),
        closed_loop(rng, phase=2.9, stretch=0.8, **lacking),
        closed_loop(rng, phase=-1.7, pulses=40.0, **lacking),
    ]


NOMINAL = Model([[90.0]], [[250.0]], [[0.0]], hold="zoh")


@pytest.fixture(scope="module")
def answer(machine):
    return find_gap(machine[:2], machine[2:], NOMINAL, power=False)


def test_all_four_are_named_in_the_order_of_their_size(answer):
    assert answer.verdict.word == "effect"
    assert [e.name for e in answer.added][:1] == ["coulomb_friction"]
    assert {e.name for e in answer.added} == {
        "coulomb_friction", "asymmetric_friction", "input_delay", "position_ripple",
    }  # fmt: skip


def test_their_sizes_are_right(answer):
    found = {e.name: e for e in answer.added}
    assert found["coulomb_friction"].force == pytest.approx(20, rel=0.03)
    assert found["asymmetric_friction"].damping == pytest.approx(-37, rel=0.1)
    assert found["input_delay"].delay == pytest.approx(H, rel=0.2)
    assert found["position_ripple"].amplitude == pytest.approx(2.0, rel=0.1)
    assert found["position_ripple"].pitch == pytest.approx(PITCH, rel=1e-3)
    assert answer.better.mass[0, 0] == pytest.approx(MASS, rel=0.01)


def test_the_held_out_force_error_falls_although_the_phase_is_new(answer):
    gaps = answer.force_gaps
    assert gaps["better"] < 0.2 * gaps["refitted"] < gaps["given"]


def test_a_closed_loop_in_which_nothing_is_missing_gets_no_name():
    rng = np.random.default_rng(3)
    records = [closed_loop(rng), closed_loop(rng, pulses=40.0)]
    answer = find_gap(
        records[:1], records[1:], Model([[MASS]], [[DAMPING]], [[0.0]], hold="zoh"), power=False
    )
    assert not answer.added and answer.verdict.word in ("none", "parameters")


def test_a_force_that_no_catalogue_names_stays_unnamed():
    rng = np.random.default_rng(4)

    def shape(x, v):
        return 6e5 * x * x * v

    records = [closed_loop(rng, other=shape), closed_loop(rng, other=shape, pulses=40.0)]
    answer = find_gap(records[:1], records[1:], NOMINAL, power=False)
    assert answer.verdict.word == "unknown"
    assert "x^2 v" in answer.verdict.reason


def test_lost_samples_are_left_out(machine):
    record, lost = machine[0], np.random.default_rng(1).random(machine[0].N) < 0.002
    spoilt = np.where(lost[:, None], 7.0, record.y)
    flagged = Record(record.t, record.u, spoilt, quality=lost.astype(np.uint8), hold="zoh")
    answer = find_gap([flagged], machine[2:], NOMINAL, power=False)
    assert answer.added[0].name == "coulomb_friction"
    assert answer.added[0].force == pytest.approx(20, rel=0.05)
    assert answer.force_gaps["better"] < 0.25 * answer.force_gaps["refitted"]


def coupled(rng, N=6000, friction=3.0, slack=0.0, noise=1e-6):
    """Record of two masses on a spring, both seen and free to drift; the first is driven, the second rubs."""
    u, y = np.repeat(rng.standard_normal(N // 30), 30) * 12, np.zeros((N, 2))
    x, v = np.zeros(2), np.zeros(2)

    def acceleration(force):
        apart = x[0] - x[1]
        link = 900.0 * (apart - min(max(apart, -slack), slack)) + 2.0 * (v[0] - v[1])
        rub = friction * min(max(v[1] / 1e-3, -1), 1)
        return np.array([force - link - 3.0 * v[0], link - rub - 3.0 * v[1]]) / np.array([2.0, 1.0])

    for i in range(N):
        y[i] = x + noise * rng.standard_normal(2)
        for _ in range(FINE):
            v = v + H / FINE / 2 * acceleration(u[i])
            x = x + H / FINE * v
            v = v + H / FINE / 2 * acceleration(u[i])
    return Record(H * np.arange(N), u[:, None], y, hold="zoh")


CHAIN = Model(
    [[2.0, 0], [0, 1.0]], [[5.0, -2.0], [-2.0, 5.0]], [[900.0, -900.0], [-900.0, 900.0]],
    input_map=[[1.0], [0.0]], hold="zoh",
)  # fmt: skip


def test_friction_of_two_free_masses_is_placed():
    rng = np.random.default_rng(2)
    answer = find_gap([coupled(rng)], [coupled(rng)], CHAIN, power=False)
    assert [(e.name, e.dof) for e in answer.added] == [("coulomb_friction", 1)]
    assert answer.added[0].force == pytest.approx(3.0, rel=0.05)


def test_slack_between_two_free_masses_is_no_stop():
    """The same force but for a spring: the one that leaves the spring as it was believed to be is named."""
    rng = np.random.default_rng(3)
    answer = find_gap(*([coupled(rng, friction=0.0, slack=0.002)] for _ in range(2)), CHAIN, power=False)
    assert [(e.name, e.dof) for e in answer.added] == [("dead_zone", (0, 1))]
    assert answer.added[0].gap == pytest.approx(0.002, rel=0.02)


def test_a_drift_under_so_much_noise_that_it_drowns_the_force_is_judged_by_free_run():
    rng = np.random.default_rng(5)
    records = [[coupled(rng, friction=0.0, noise=0.01)] for _ in range(2)]
    answer = find_gap(*records, CHAIN, power=False)
    assert answer.judged is None
    assert answer.verdict.word == "none" and not answer.added
    records = [[coupled(rng, noise=0.01)] for _ in range(2)]
    answer = find_gap(*records, CHAIN, power=False)
    assert [(e.name, e.dof) for e in answer.added] == [("coulomb_friction", 1)]
    assert answer.added[0].force == pytest.approx(3.0, rel=0.1)


def two_masses(rng, N=4000, m=(2.0, 0.6), d=1.5, hertz=6.0):
    """Record of the first of two masses, both free, under a stepwise force."""
    u, y = np.repeat(rng.standard_normal(N // 20), 20) * 10, np.zeros(N)
    x, v, inverse, k = np.zeros(2), np.zeros(2), 1 / np.array(m), m[1] * (2 * np.pi * hertz) ** 2

    def acceleration(force):
        link = k * (x[0] - x[1]) + d * (v[0] - v[1])
        return np.array([force - 4.0 * v[0] - link, link]) * inverse

    for i in range(N):
        y[i] = x[0] + 1e-7 * rng.standard_normal()
        for _ in range(FINE):
            v = v + H / FINE / 2 * acceleration(u[i])
            x = x + H / FINE * v
            v = v + H / FINE / 2 * acceleration(u[i])
    return Record(H * np.arange(N), u[:, None], y[:, None], hold="zoh")


def test_a_hidden_mode_of_a_free_mass_is_found():
    rng = np.random.default_rng(5)
    records = [two_masses(rng), two_masses(rng)]
    answer = find_gap(records[:1], records[1:], Model([[2.2]], [[4.0]], [[0.0]], hold="zoh"), power=False)
    assert [e.name for e in answer.added] == ["extra_mode"]
    assert answer.added[0].frequency == pytest.approx(6.0, rel=0.01)
    assert answer.added[0].mass == pytest.approx(0.6, rel=0.03)
    assert answer.force_gaps["better"] < 0.05 * answer.force_gaps["refitted"]


def test_a_gain_that_one_stretch_makes_is_sure_only_where_it_is_large_and_harms_none():
    once, even = np.zeros(12), np.full(12, 10.0)
    once[4] = 120.0
    assert is_sure(even, left=1e4)
    assert is_sure(once, left=200.0)
    assert not is_sure(once, left=1000.0)
    assert not is_sure(once - 2.0 * (np.arange(12) % 2), left=200.0)


def test_a_record_of_few_times_is_drawn_over_time(monkeypatch):
    t = np.linspace(0, 1, 40)
    monkeypatch.setattr(gap_figures, "leftover", lambda answer: [(t, np.ones((40, 2)))] * 2)
    drawn = gap_figures._over_time(answer=None)
    assert drawn.count("<path") > 3 and "nan" not in drawn
