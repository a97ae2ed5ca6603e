"""Difference equations: theory, least squares, instruments, and what the paper misprints."""

import identification as ident
import numpy as np
import pytest

from sysid_bench.mechanics import kapucu_baysec as kb
from sysid_bench.mechanics.conversion import zoh_coefficients
from sysid_bench.mechanics.second_order import pack
from sysid_bench.methods.arx import Arx
from sysid_bench.nouns import InputError, Model, NotApplicable, Record


@pytest.mark.parametrize("c", [0.0, 1.0, 2.0, 4.0])
def test_the_papers_closed_forms_are_the_exact_zero_order_hold(c):
    for m, k in ((1.0, 1.0), (2.0, 3.0)):
        for T in np.linspace(0.05, 2 * np.pi, 60):
            exact, closed = kb.exact(m, c, k, T), kb.closed_form(m, c, k, T)
            assert closed == pytest.approx(exact, abs=1e-12)


def test_printed_36_has_the_wrong_b2():
    at_one = kb.underdamped(1.0, 1.0, 1.0, 1.0, printed=True)["b2"]
    assert at_one == pytest.approx(0.480, abs=5e-4)
    assert kb.exact(1.0, 1.0, 1.0, 1.0)["b2"] == pytest.approx(0.242, abs=5e-4)
    assert kb.underdamped(1.0, 1.0, 1.0, 0.01, printed=True)["b2"] == pytest.approx(0.0050, rel=0.01)
    assert kb.exact(1.0, 1.0, 1.0, 0.01)["b2"] == pytest.approx(5.0e-5, rel=0.01)


@pytest.mark.parametrize("misprint", [m for m in kb.MISPRINTS if m.checked], ids=lambda m: m.equation)
def test_each_misprint_is_wrong_as_printed_and_right_as_corrected(misprint):
    at = (2.0, 1.0, 3.0, 0.7)
    assert misprint.corrected(*at) == pytest.approx(misprint.exact(*at), rel=1e-12, abs=1e-14)
    assert abs(misprint.printed(*at) - misprint.exact(*at)) > 1e-3 * abs(misprint.exact(*at))


def test_rounding_puts_critical_damping_in_the_underdamped_branch():
    m, k = 2.0, 3.0
    c = 2 * np.sqrt(k * m)
    assert c**2 < 4 * k * m
    assert kb.exact(m, c, k, 0.7) == pytest.approx(kb.critically_damped(m, k, 0.7), abs=1e-13)


def test_theory_of_several_masses_predicts_the_sampled_response():
    L, C = np.array([[1.0], [0], [0]]), np.array([[0, 0, 1.0]])
    u = ident.binary(80, 1, 0)
    y = ident.simulated(ident.THREE_DOF, u, 0.7, "zoh", L=L, C=C).y[:, 0]
    named = zoh_coefficients(*ident.THREE_DOF, L, C, 0.7)
    a = np.array([named[f"a{j}"] for j in range(1, 7)])
    b = np.array([named[f"b{j}"] for j in range(7)])
    for k in range(6, 80):
        assert y[k] == pytest.approx(b @ u[k - 6 : k + 1, 0][::-1] - a @ y[k - 6 : k][::-1], abs=1e-10)


@pytest.mark.parametrize("plant", [ident.ONE_DOF, ident.UNEVEN], ids=["one_dof", "three_dof"])
@pytest.mark.parametrize("hold", ["zoh", "foh"])
@pytest.mark.parametrize("recover", ["instruments", "least_squares"])
def test_noise_free_data_give_the_plant_back(plant, hold, recover):
    record = ident.simulated(plant, ident.binary(400, len(plant[0]), 1), 0.5, hold)
    estimate = Arx(recover=recover).fit(record, ident.model_of(plant))
    assert ident.errors(estimate, plant).max() < 1e-8


def test_coefficients_are_those_of_theory_without_noise():
    record = ident.simulated(ident.ONE_DOF, ident.binary(44, 1, 2), 1.0, "zoh")
    found = Arx().fit(record, Model(n=1)).coefficients
    assert found == pytest.approx(kb.exact(1.0, 0.2, 1.0, 1.0), abs=1e-12)
    assert list(found) == ["a1", "a2", "b0", "b1", "b2"]


def test_output_noise_biases_least_squares_and_not_the_instruments():
    plant, u = ident.THREE_DOF, ident.binary(6000, 3, 3)
    record = ident.simulated(plant, u, 0.1, "zoh", 20, np.random.default_rng(0))
    biased = ident.errors(Arx(recover="least_squares").fit(record, ident.model_of(plant)), plant)
    sound = ident.errors(Arx().fit(record, ident.model_of(plant)), plant)
    assert biased[0] > 0.3 and biased[1] > 1
    assert sound.max() < 0.03


def test_white_equation_noise_biases_neither():
    rng, truth = np.random.default_rng(5), kb.exact(1.0, 0.2, 1.0, 0.5)
    u, y = ident.binary(4000, 1, 4), np.zeros((4000, 1))
    noise = 0.02 * rng.standard_normal(4000)
    for k in range(2, 4000):
        past = -truth["a1"] * y[k - 1, 0] - truth["a2"] * y[k - 2, 0]
        y[k, 0] = past + truth["b1"] * u[k - 1, 0] + truth["b2"] * u[k - 2, 0] + noise[k]
    record = Record(0.5 * np.arange(4000), u, y, "zoh")
    for recover in ("instruments", "least_squares"):
        estimate = Arx(recover=recover).fit(record, Model(n=1))
        deviation = np.abs(pack(estimate.M, estimate.D, estimate.K) - [1, 0.2, 1])
        assert np.all(deviation < 4 * np.sqrt(np.diag(estimate.covariance)))
        assert deviation.max() < 0.03


def test_standard_errors_cover_the_truth():
    runs = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        record = ident.simulated(ident.ONE_DOF, ident.binary(800, 1, seed), 0.5, "zoh", 20, rng)
        runs.append(Arx().fit(record, Model(n=1)))
    assert 0.87 <= ident.covered(runs, ident.ONE_DOF, pack).mean() <= 0.995


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plant", "h"), [(ident.ONE_DOF, 0.2), (ident.THREE_DOF, 0.25)], ids=["one", "three"]
)
def test_200_intervals_cover_the_truth(plant, h):
    runs = []
    for seed in range(200):
        rng, n = np.random.default_rng(seed), len(plant[0])
        record = ident.simulated(plant, ident.binary(2000, n, seed), h, "zoh", 20, rng)
        runs.append(Arx().fit(record, ident.model_of(plant)))
    assert 0.90 <= ident.covered(runs, plant, pack).mean() <= 0.99


@pytest.mark.slow
def test_pole_zero_cancellation_frees_a_common_factor_and_leaves_b1():
    """At T = pi/omega_d the equation has the factor z + p twice; white noise then chooses e = -p/(1 + p^2)."""
    m, c, k = 1.0, 1.0, 1.0
    T = np.pi / np.sqrt(0.75)
    found = []
    for seed in range(400):
        rng = np.random.default_rng(seed)
        record = ident.simulated(
            (m * np.eye(1), c * np.eye(1), k * np.eye(1)), 0.5 * ident.binary(44, 1, seed), T, "zoh"
        )
        noisy = Record(record.t, record.u, record.y + 0.01 * rng.standard_normal(record.y.shape), "zoh")
        got = Arx().fit(noisy, Model(n=1)).coefficients
        found.append([got[name] for name in ("a1", "a2", "b2", "b1")])
    median = np.median(found, axis=0)
    assert np.allclose(median[:3], [0.004, -0.026, -0.185], atol=0.05)
    assert median[3] == pytest.approx(1.163, abs=0.01)


def test_a_pole_without_logarithm_keeps_the_coefficients_and_says_why():
    record = ident.simulated(ident.ONE_DOF, ident.binary(60, 1, 0), 0.5, "zoh")
    estimate = Arx(na=1, nb=2).fit(record, Model(n=1))
    assert estimate.M is None and "order 2" in estimate.reason
    assert set(estimate.coefficients) == {"a1", "b0", "b1"}


def test_unsuitable_records_are_declined_with_a_reason():
    record = ident.simulated(ident.ONE_DOF, ident.binary(60, 1, 0), 0.5, "zoh")
    uneven = Record(record.t**1.1, record.u, record.y, "zoh")
    flagged = Record(record.t, record.u, record.y, "zoh", np.r_[1, np.zeros(59)])
    for bad in (uneven, flagged, Record(record.t[:5], record.u[:5], record.y[:5], "zoh")):
        with pytest.raises(NotApplicable):
            Arx().fit(bad, Model(n=1))
    with pytest.raises(InputError, match="input_map"):
        Arx().fit(record, Model(n=2))
    with pytest.raises(InputError, match="recover"):
        Arx(recover="wishes")


@pytest.mark.parametrize("c", [0.0, 2.0, 4.0])
def test_all_dampings_without_noise(c):
    plant = (np.eye(1), c * np.eye(1), np.eye(1))
    record = ident.simulated(plant, ident.binary(60, 1, 1), 0.5, "zoh")
    found = Arx().fit(record, Model(n=1))
    assert np.allclose(pack(found.M, found.D, found.K), [1, c, 1], atol=1e-6)
