"""Where a first look misleads: a sensor whose zero is off, a fit that creeps, a friction whose law is only nearly ours."""

import numpy as np
import pytest
from scipy.signal import cont2discrete

from sysid_bench.effects import effect, effect_class, names
from sysid_bench.gap.candidates import Candidate
from sysid_bench.gap.check_data import check_data
from sysid_bench.gap.choose import _other_firsts
from sysid_bench.gap.contend import Arena
from sysid_bench.gap.descent import fit, free_parameters
from sysid_bench.gap.look import from_the_nominal
from sysid_bench.gap.prepare import prepared
from sysid_bench.gap.price import Contender, price
from sysid_bench.gap.problem import Point
from sysid_bench.gap.refit import linear_fit
from sysid_bench.gap.screen import screen
from sysid_bench.gap.show import moved_values
from sysid_bench.gap.story import Round
from sysid_bench.gap.thresholds import Thresholds
from sysid_bench.gap.workflow import find_gap
from sysid_bench.nouns import Model, Record

H, FINE = 0.25, 24
MODEL = Model([[1.0]], [[0.04]], [[1.0]], hold="zoh")


def record(seed, law, N=2000, slow=False, drift=0.0, snr_db=30.0):
    """One mass on a spring (Runge-Kutta), with a force law(x, v, z) -> (force, dz/dt); sensor with drift, in rms at the end."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(N)
    if slow:
        u = np.convolve(rng.standard_normal(N + 7), np.ones(8) / 3, "valid")
    y, s, h = np.zeros((N, 1)), np.zeros(3), H / FINE

    def change(s, force):
        f, dz = law(*s)
        return np.array([s[1], force - 0.04 * s[1] - s[0] - f, dz])

    for i in range(N):
        y[i] = s[0]
        for _ in range(FINE):
            a = change(s, u[i])
            b = change(s + h / 2 * a, u[i])
            c = change(s + h / 2 * b, u[i])
            s = s + h / 6 * (a + 2 * b + 2 * c + change(s + h * c, u[i]))
    rms = y.std()
    y += 10 ** (-snr_db / 20) * rms * rng.standard_normal(y.shape)
    y += drift * rms * np.linspace(0, 1, N)[:, None]
    return Record(H * np.arange(N), u[:, None], y, hold="zoh")


def bristles(x, v, z):
    """LuGre friction, damped bristles included (Canudas de Wit et al. 1995)."""
    level, stiffness, damping = 0.4, 4.0, 0.3
    dz = v - stiffness * abs(v) * z / level
    return stiffness * z + damping * dz, dz


def test_damped_bristles_are_one_friction_not_two():
    train, test = ([record(seed, bristles, slow=True, snr_db=32)] for seed in (1, 2))
    answer = find_gap(train, test, MODEL, power=False)
    assert [(e.name, e.dof) for e in answer.added] == [("presliding_friction", 0)]


def test_a_drift_is_no_tone_of_a_small_part_of_a_turn():
    """Beside a drift a spring is named; a slow sine, fitted off its grid, had been as good as the drift."""
    train, test = ([record(seed, lambda x, v, z: (0.02 * x * x, 0.0), drift=0.6)] for seed in (3, 4))
    answer = find_gap(train, test, MODEL, power=False)
    assert {e.name for e in answer.added} == {"quadratic_stiffness", "sensor_drift"}


def test_a_zero_that_is_off_is_tried_first_where_nothing_else_leads_to_an_explanation():
    records = [record(3, lambda x, v, z: (0.02 * x * x, 0.0), slow=True, drift=0.8)]
    problem = prepared(records, MODEL, check_data(records))[0]
    linear = linear_fit(problem)
    catalogue = [effect_class(name) for name in names()]
    first = Round(screen(problem, linear, catalogue), [], linear, None)
    (found,) = _other_firsts(problem, first)
    assert found.chosen is found.contenders[0]
    assert found.chosen.effect.name == "sensor_drift"
    end = found.chosen.effect.rate * records[0].t[-1] + found.chosen.effect.curvature * records[0].t[-1] ** 2
    assert end == pytest.approx(0.8 / np.hypot(1, 0.8 / np.sqrt(12)) * records[0].y.std(), rel=0.15)
    assert not list(_other_firsts(problem, found))  # it has been first


def test_a_fit_that_creeps_from_a_bent_refit_is_done_once_morefrom_the_nominal():
    records = [record(5, lambda x, v, z: (0.02 * x**3, 0.0))]
    problem = prepared(records, MODEL, check_data(records))[0]
    cubic = effect("cubic_stiffness", 0, {"stiffness": 0.01})
    bent = Point(np.array([0.3, 0.5, -0.2]), (cubic,), problem.begins)
    crept = fit(problem, bent, free_parameters(bent.effects), 1)
    base = fit(problem, Point(bent.theta, (), problem.begins), (), 0)
    candidate = Candidate(cubic, 0.0, 0.0, np.zeros(0), bent.theta, False)
    found = from_the_nominal(Arena(problem, base), [Contender(crept, candidate, price(problem, crept))])
    assert crept.rho > 2
    assert found[0].fit.rho < 1.2
    assert found[0].effect.stiffness == pytest.approx(0.02, rel=0.05)
    assert not from_the_nominal(Arena(problem, base), found)  # nothing is left: once is enough


def test_masses_that_one_sensor_leaves_uncertain_are_still_wrong_parameters():
    rng = np.random.default_rng(6)
    M, D = np.diag([1.0, 1.2]), np.array([[0.05, -0.02], [-0.02, 0.05]])
    K, L, C = np.array([[1.8, -0.9], [-0.9, 1.7]]), [[1.0], [0.0]], [[0.0, 1.0]]
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    B = np.concatenate([np.zeros((2, 1)), np.linalg.solve(M, L)])
    Ad, Bd, *_ = cont2discrete((A, B, np.hstack([C, np.zeros((1, 2))]), np.zeros((1, 1))), H)
    records = []
    for _ in range(2):
        u, s, y = rng.standard_normal((3000, 1)), np.zeros(4), np.zeros((3000, 1))
        for i in range(3000):
            y[i], s = s[1], Ad @ s + Bd @ u[i]
        y += 0.03 * y.std() * rng.standard_normal(y.shape)
        records.append([Record(H * np.arange(3000), u, y, hold="zoh")])
    wrong = Model(M * [[1.25], [1.0]], D, K, input_map=L, output_map=C, hold="zoh")
    answer = find_gap(*records, wrong, power=False)
    assert answer.verdict.word == "parameters" and not answer.added
    assert moved_values(answer, Thresholds())
    assert answer.gap_after < 0.2 * answer.gap_before


def test_the_frequency_of_a_swinging_spring_is_found_off_a_lightly_damped_mode():
    """What it makes of a mode lies beside it, where the plant answers little: a line counts against what would make it."""
    swing = 0.4 / (2 * np.pi)
    records = [
        record(8, lambda x, v, z: (0.2 * np.sin(2 * np.pi * swing * z) * x, 1.0), N=3000)  # z is the time
    ]
    problem = prepared(records, MODEL, check_data(records))[0]
    screened = screen(problem, linear_fit(problem), [effect_class(name) for name in names()])
    best = screened.candidates[0]
    assert best.effect.name == "time_varying_stiffness"
    assert best.effect.frequency == pytest.approx(swing, abs=1 / (4 * 3000 * H))
    assert best.explained > 0.9 * screened.left
