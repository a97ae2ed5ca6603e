"""A motion that no free run follows: the story told while the simulation is held near it, and what that must not do."""

from dataclasses import replace

import numpy as np
import pytest

from sysid_bench.effects import effect_class
from sysid_bench.gap.check_data import check_data
from sysid_bench.gap.decide import Thresholds, decide
from sysid_bench.gap.descent import fit, free_parameters
from sysid_bench.gap.motion import seen
from sysid_bench.gap.nudge import held_near, leads
from sysid_bench.gap.prepare import prepared
from sysid_bench.gap.problem import Point, evaluate
from sysid_bench.gap.refit import linear_fit
from sysid_bench.gap.screen import screen
from sysid_bench.gap.story import Story
from sysid_bench.gap.workflow import find_gap
from sysid_bench.nouns import Model, Record

h, N, FINE = 0.03, 4000, 30
M, D, K = 1.3, 0.8, 205.0
AMPLITUDE, PITCH, PHASE = 3.0, 0.044, 1.0


def _rippled(seed: int) -> Record:
    """A ripple whose pitch is smaller than the motion: chaotic. Simulated by steps of h / 30, leapfrog with damping."""
    rng = np.random.default_rng(seed)
    u = 3 * np.convolve(rng.normal(size=N + 20), np.ones(3) / np.sqrt(3), "same")[:N]
    x, v, step, y = 0.0, 0.0, h / FINE, np.empty(N)
    for k in range(N):
        y[k] = x
        for _ in range(FINE):
            x += 0.5 * step * v
            force = u[k] - K * x + AMPLITUDE * np.sin(2 * np.pi * x / PITCH + PHASE)
            v = (v * (1 - 0.5 * step * D / M) + step * force / M) / (1 + 0.5 * step * D / M)
            x += 0.5 * step * v
    y += 0.02 * y.std() * rng.normal(size=N)
    return Record(np.arange(N) * h, u[:, None], y[:, None], hold="zoh")


@pytest.fixture(scope="module")
def chaotic():
    record, model = _rippled(1), Model(M * np.eye(1), D * np.eye(1), K * np.eye(1), hold="zoh")
    problem = prepared([record], model, check_data([record]))[0]
    linear = linear_fit(problem)
    seens = [seen(problem, linear.point, *x) for x in zip(problem.traces, linear.runs, linear.point.starts)]
    return record, model, problem, held_near(problem, seens)


def _start(problem, *effects) -> Point:
    return replace(problem.nominal(), effects=effects)


def test_a_chaotic_ripple_is_named_while_the_simulation_is_held_near_the_motion(chaotic):
    record, model, problem, held = chaotic
    truth = effect_class("position_ripple")(0, AMPLITUDE, PITCH, PHASE)
    free, near = (evaluate(one, _start(one, truth))[0] for one in (problem, held))
    assert free @ free > 20 * len(free)  # of the truth
    assert near @ near < 2 * len(near)
    answer = find_gap([record], [_rippled(2)], model, power=False)
    assert [(e.name, e.dof) for e in answer.added] == [("position_ripple", 0)]
    assert answer.added[0].values[:2] == pytest.approx([AMPLITUDE, PITCH], rel=0.1)
    assert "held near the measured motion" in answer.verdict.reason


def test_held_m_d_k_stay_near_the_nominal_and_at_the_end_of_that_nothing_is_named(chaotic):
    _, _, _, held = chaotic
    drag = effect_class("quadratic_drag")(0, 1e-6)
    bent = fit(held, _start(held, drag), free_parameters((drag,)), 30)
    assert np.all(np.abs(bent.point.theta) <= held.prior)
    at_end = replace(bent, point=replace(bent.point, theta=np.array([-1, 0.0, 0]) * held.prior))
    loose = replace(at_end, rows=0.9 * at_end.rows / np.sqrt(at_end.rho))  # as if it left nothing
    word = decide(held, Story(bent, loose), 100.0, 0, Thresholds()).word
    inside = replace(loose, point=replace(loose.point, theta=np.array([-0.5, 1.0, 0]) * held.prior))
    assert (word, decide(held, Story(bent, inside), 100.0, 0, Thresholds()).word) == ("unknown", "effect")


def test_near_a_motion_neither_drives_nor_sensors_are_suspected_and_nothing_is_held_twice(chaotic):
    _, _, _, held = chaotic
    nominal = fit(held, held.nominal(), (), 0)
    catalogue = [effect_class(name) for name in ("saturation", "sensor_bias", "position_ripple")]
    found = screen(held, nominal, catalogue)
    assert {c.effect.name for c in found.candidates if not c.decoy} == {"position_ripple"}
    assert {c.effect.path for c in found.candidates} == {"force"}
    assert leads(held, found.seens) == ()


def test_a_sensor_that_sees_two_masses_holds_neither(chaotic):
    _, _, problem, _ = chaotic
    two = Model(M * np.eye(2), D * np.eye(2), K * np.eye(2), output_map=np.ones((1, 2)), hold="zoh")
    assert held_near(replace(problem, model=two), []) is None
