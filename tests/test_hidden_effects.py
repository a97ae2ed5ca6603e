"""The hidden trials: their engine against another integrator, their truths in the catalogue's words, their bookkeeping."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

FOLDER = Path(__file__).parents[1] / "experiments" / "hidden_effects"


@pytest.fixture(scope="module", autouse=True)
def path():
    sys.path.insert(0, str(FOLDER))
    yield
    sys.path.remove(str(FOLDER))


def test_the_engine_agrees_with_radau():
    from engine import BOUC_WEN, CUBIC, fine_input, integrate

    M, D, K = np.diag([0.8, 2.0]), 0.1 * np.eye(2), np.array([[4.0, -1], [-1, 4]])
    kinds, c = np.array([CUBIC, BOUC_WEN]), np.array([[1.0, 0], [1.0, -1]])
    P = np.array([[3.0, 0, 0, 0, 0, 0], [1.5, 2.0, 1.0, 1.0, 0, 0]])
    h, N, small = 0.05, 200, 12
    u = np.sin(0.8 * h * np.arange(N))[:, None] * [[1.0, 0.3]]
    Q, _ = integrate(
        M, D, K, fine_input(u, h, "foh", small), h, small, False, kinds, c, P, np.zeros(2), np.zeros(2)
    )

    def rate(t, x):
        q, v, z = x[:2], x[2:4], x[4]
        w = np.array([np.interp(t, h * np.arange(N), col) for col in u.T])
        s = v[0] - v[1]
        f = w - D @ v - K @ q - np.array([3.0 * q[0] ** 3, 0]) - 1.5 * z * np.array([1.0, -1])
        return [*v, *np.linalg.solve(M, f), s - 2.0 * abs(s) * z - 1.0 * s * abs(z)]

    t = h * np.arange(N)
    true = solve_ivp(rate, (0, t[-1]), np.zeros(5), "Radau", t, rtol=1e-8, atol=1e-10, max_step=h).y[:2].T
    assert np.abs(Q - true).max() < 1e-4 * np.abs(true).max()


def test_play_in_the_engine_does_not_lag_by_its_steps():
    """Play that follows only at the end of a step lags by half of it: a damping that no interval of a fit would hold."""
    from engine import PLAY, fine_input, integrate

    h, N = 0.05, 400
    u = 2 * np.sin(0.9 * h * np.arange(N))[:, None]

    def moved(small):
        place, P = np.array([[1.0]]), np.array([[0.7, 0.5, 0, 0, 0, 0]])
        fine = fine_input(u, h, "foh", small)
        M, D = np.eye(1), 0.15 * np.eye(1)
        return integrate(
            M, D, np.eye(1), fine, h, small, False, np.array([PLAY]), place, P, *np.zeros((2, 1))
        )[0]

    true = moved(400)
    assert np.abs(moved(12) - true).max() < 1e-4 * np.abs(true).max()


def test_a_held_input_is_delayed_by_the_delay_itself():
    """What has arrived by any time is what was sent a delay earlier, however the delay lies to the small steps."""
    from engine import fine_input

    h, small, delay = 0.05, 12, 0.0371
    u = np.random.default_rng(4).normal(size=(40, 1))
    w = fine_input(u, h, "zoh", small, delay)[1::2, 0]  # what a held small step takes
    arrived = np.cumsum(w) * h / small
    t = (1 + np.arange(len(w))) * h / small - delay
    sent = np.interp(t, h * np.arange(41), np.concatenate([[0], np.cumsum(u) * h]))
    assert np.allclose(arrived, sent, atol=1e-12)


def test_intervals_are_asked_of_the_true_structure_alone():
    from coverage import errors

    found = list(errors("sensor_bias", "one", 3006))
    assert [key for key, _ in found] == ["bias"] and abs(found[0][1]) < 4


def test_intervals_of_a_friction_hold_for_another_rounding_than_the_fitted_one():
    """The engine rounds its sign by a square root, the catalogue by a tanh: by noise alone they differ 14 standard errors."""
    from coverage import errors

    assert all(abs(z) < 3 for _, z in errors("coulomb_friction", "one", 3302))
    assert list(errors("coulomb_friction", "one", 3302))


def names():
    sys.path.insert(0, str(FOLDER))
    from draw import ACTUATORS, FORCES

    sys.path.remove(str(FOLDER))
    return [*FORCES, *ACTUATORS, "sensor_bias", "sensor_drift"]


@pytest.mark.parametrize("name", names())
def test_the_truth_is_the_catalogues_effect_with_the_same_numbers(name):
    """The suite's own simulator with the true effect shows what the engine showed, noise aside."""
    from attempt import model_of, records_of, true_effect
    from draw import Draw

    from sysid_bench.gap.prove import prove
    from sysid_bench.nouns import Model

    draw = Draw(7, kind="single", size="three", name=name)
    trial = draw.trial(0.0)
    (effect,) = (true_effect(x) for x in trial.truth["effects"])
    record = records_of(trial)[1][0]
    given = model_of(trial)
    noise = trial.truth["noise_share"]
    with_effect = Model(
        given.mass, given.damping, given.stiffness, input_map=given.input_map, hold=given.hold,
        initial_state=given.initial_state, effects=(effect,),
    )  # fmt: skip
    assert prove(with_effect, record).gap < 1.05 * noise + 0.004 < prove(given, record).gap


def test_wilson_holds_the_share_and_narrows():
    from tally import wilson

    low, high = wilson(95, 100)
    assert low < 0.95 < high and (low, high) == pytest.approx((0.888, 0.978), abs=2e-3)
    assert wilson(0, 0) == (0.0, 1.0) and wilson(300, 300)[0] > 0.98


@pytest.mark.parametrize("stratum", ["unmeasured DOFs", "2 % samples lost", "closed loop", "two amplitudes"])
def test_harder_records_are_what_they_say(stratum):
    from attempt import model_of, records_of
    from draw import Draw

    trial = Draw(3, kind="single", size="three", name="cubic_stiffness", stratum=stratum).trial()
    train, test = records_of(trial)
    model = model_of(trial)
    assert model.ny == train[0].ny == test[0].ny
    assert (model.ny < 3) == (stratum == "unmeasured DOFs")
    assert (len(train) == 2) == (stratum == "two amplitudes")
    lost = np.mean([not r.all_good and np.mean(r.quality > 0) for r in (*train, *test)])
    assert 0.012 < lost < 0.03 if stratum == "2 % samples lost" else lost == 0
    plain = Draw(3, kind="single", size="three", name="cubic_stiffness").trial()
    assert np.any(train[0].u != plain.train[0]) == (stratum == "closed loop")


def test_a_run_goes_on_where_it_stopped_and_opens_the_seal(tmp_path):
    out = tmp_path / "trials.jsonl"

    def call(*words):
        done = subprocess.run(
            [sys.executable, str(FOLDER / "trials.py"), *words], capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    run = ["run", "--first", "40", "--kind", "single", "--size", "one", "--out", str(out)]
    call(*run, "--count", "1")
    again = call(*run, "--count", "2", "--jobs", "2")
    answers = [json.loads(line) for line in out.read_text().splitlines()]
    assert [a["seed"] for a in answers] == [40, 41] and " 41 " in again and " 40 " not in again
    assert "true" not in answers[0] and "effects" not in answers[0]
    text = call("table", str(out), "--csv", str(tmp_path / "trials.csv"))
    assert "| single | 2 |" in text and len((tmp_path / "trials.csv").read_text().splitlines()) == 3
    call("figure", str(out), "--out", str(tmp_path / "figures"))
    assert {p.suffix for p in (tmp_path / "figures").iterdir()} == {".png", ".svg"}


def test_coarse_steps_of_a_slow_motion_are_the_fault_of_the_data_and_nothing_else():
    """Their rounding lies where the motion does, above the floor of the highest frequencies."""
    from attempt import attempt

    answer, _ = attempt(4004, 5, kind="single", size="one", name="quantisation")
    assert answer["verdict"] == "effect"
    assert [effect["name"] for effect in answer["said"]] == ["quantisation"]
