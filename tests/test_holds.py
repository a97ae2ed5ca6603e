"""Closed-form propagation against a Runge-Kutta integrator, for every hold and every kind of plant."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from test_second_order import plant

from sysid_bench.mechanics.bandlimited import evaluate, input_lines
from sysid_bench.mechanics.holds import propagate
from sysid_bench.mechanics.phi import divided_difference, phi
from sysid_bench.mechanics.rules import RULES, rule
from sysid_bench.mechanics.second_order import state_space
from sysid_bench.nouns import InputError

PLANTS = {"one_dof_undamped": 0.4, "one_dof": 0.4, "one_dof_critical": 0.4, "one_dof_overdamped": 0.4}
PLANTS |= {"three_dof": 0.25, "eight_dof": 0.02}


def system(name):
    p = plant(name)
    return state_space(p.mass, p.damping, p.stiffness, p.input_map, p.output_map)[:2]


def reference(A, B, u_of_t, h, N, x0):
    """DOP853 from sample to sample, so that jumps of the input fall on the ends of the intervals."""
    x = [x0]
    for k in range(N - 1):
        rhs = lambda t, x, k=k: A @ x + B @ u_of_t(t, k)  # noqa: E731
        x.append(solve_ivp(rhs, (k * h, (k + 1) * h), x[-1], "DOP853", rtol=1e-11, atol=1e-15).y[:, -1])
    return np.array(x)


def between(hold, u, h):
    """u(t) on step k, written down independently of the suite."""
    t = h * np.arange(len(u))
    if hold == "zoh":
        return lambda s, k: u[k]
    if hold == "foh":
        return lambda s, k: u[k] + (s - t[k]) / h * (u[k + 1] - u[k])
    if hold == "cubic":
        spline = CubicSpline(t, u)
        return lambda s, k: spline(s)
    lines, w = np.fft.fft(u, axis=0) / len(u), 2 * np.pi * np.fft.fftfreq(len(u), h)
    return lambda s, k: np.cos(w * s) @ lines.real - np.sin(w * s) @ lines.imag


@pytest.mark.parametrize("hold", ["zoh", "foh", "cubic", "bandlimited"])
@pytest.mark.parametrize("name", PLANTS)
def test_agrees_with_dop853(name, hold):
    (A, B), h, N = system(name), PLANTS[name], 25
    rng = np.random.default_rng(1)
    u, x0 = rng.normal(size=(N, B.shape[1])), rng.normal(size=len(A))
    x = propagate(A, B, u, h, hold, x0)
    expected = reference(A, B, between(hold, u, h), h, N, x0)
    assert np.abs(x - expected).max() < 1e-8 * np.abs(expected).max()


@pytest.mark.parametrize("hold", ["zoh", "foh", "cubic"])
def test_rigid_body_and_repeated_modes(hold):
    M, D, K = np.eye(3), np.zeros((3, 3)), np.diag([0.0, 4.0, 4.0])
    A, B = state_space(M, D, K)[:2]
    u = np.random.default_rng(2).normal(size=(25, 3))
    expected = reference(A, B, between(hold, u, 0.3), 0.3, 25, np.ones(6))
    assert np.abs(propagate(A, B, u, 0.3, hold, np.ones(6)) - expected).max() < 1e-8 * np.abs(expected).max()


def test_a_spline_with_slower_knots_is_the_spline_through_the_samples():
    knots = np.random.default_rng(3).normal(size=(12, 1))
    spline = CubicSpline(np.arange(12.0), knots)
    samples = spline(np.arange(0, 11.01, 0.25))
    dense = np.arange(0, 11, 0.01)
    assert np.allclose(CubicSpline(np.arange(0, 11.01, 0.25), samples)(dense), spline(dense), atol=1e-12)


def test_bandlimited_takes_lines_off_the_sample_grid():
    A, B = system("one_dof")
    series = (np.array([0.7, 1.9]), np.array([[1.0 - 0.5j], [0.2j]]))
    u = evaluate(input_lines(None, 0.3, None, series), series[1], 30, 0.3)
    exact = lambda t, k: (series[1].T @ np.exp(1j * series[0] * t)).real  # noqa: E731
    x = propagate(A, B, u, 0.3, "bandlimited", np.ones(2), series=series)
    assert np.allclose(x, reference(A, B, exact, 0.3, 30, np.ones(2)), atol=1e-8)


def test_the_fourier_series_of_one_period_returns_the_samples():
    one = np.random.default_rng(4).normal(size=(20, 2))
    u = np.tile(one, (3, 1))[:50]
    for samples, period in ((u, 20), (one[:19], None), (one, None)):
        lines = input_lines(samples, 0.1, period)
        assert np.allclose(evaluate(lines, lines.amplitude, len(samples), 0.1), samples, atol=1e-13)


def test_a_line_on_an_undamped_pole_is_refused():
    A, B = system("one_dof_undamped")
    with pytest.raises(InputError, match="undamped pole"):
        propagate(A, B, np.ones((9, 1)), 0.1, "bandlimited", series=(np.ones(1), np.ones((1, 1), complex)))


def test_unknown_hold_is_refused():
    with pytest.raises(InputError, match="zoh, foh, cubic"):
        rule("sinc")


@pytest.mark.parametrize("name", RULES)
def test_step_functions_and_slopes_of_a_rule_say_the_same(name):
    z, h = np.array([-0.3 + 2.0j, 0.0, -1e-3 + 1e-3j, -4.0 + 0.5j]), 0.7
    values, slopes, d = RULES[name].functions(z), RULES[name].slopes(z), 1e-5
    difference = (RULES[name].functions(z + d) - RULES[name].functions(z - d)) / (2 * d)
    assert np.allclose(slopes, difference, rtol=1e-8, atol=1e-9)
    rotation = np.array([[z[0].real, -z[0].imag], [z[0].imag, z[0].real]])  # has the eigenvalue z[0]
    Ad, weights = RULES[name].step(rotation / h, np.eye(2), h)
    for matrix, value in zip([Ad, *(weights / h)], values[:, 0]):
        assert np.allclose(matrix[0, 0] + 1j * matrix[1, 0], value, atol=1e-12)


@pytest.mark.parametrize(("name", "order"), [("cayley", 2), ("gauss2", 4)])
def test_integrators_have_their_order(name, order):
    A, B = system("three_dof")
    errors = []
    for h in (0.1, 0.05):
        t = np.arange(0, 10 + h / 2, h)
        u = np.sin(np.outer(t, [1.0, 1.3, 0.7])) ** 2
        fine = np.sin(np.outer(np.arange(0, 10 + h / 40, h / 20), [1.0, 1.3, 0.7])) ** 2
        exact = propagate(A, B, fine, h / 20, "cubic")[::20]
        errors.append(np.abs(propagate(A, B, u, h, name) - exact).max())
    assert abs(np.log2(errors[0] / errors[1]) - order) < 0.25


def test_phi_functions_at_both_sides_of_the_series_limit():
    for z in (1.9999, 2.0001, 1e-8):
        exact = [np.exp(z), np.expm1(z) / z]
        assert np.allclose(phi(np.array([z]), 1), np.array(exact)[:, None], rtol=1e-12)
    near, beyond = (np.array(phi(np.array([z * np.exp(2j)]), 5)) for z in (2 - 1e-9, 2 + 1e-9))
    assert np.allclose(near, beyond, rtol=1e-7, atol=1e-9)


def test_divided_difference_goes_over_to_the_slope():
    a = np.array([1j, -2.0, 0.3])
    for d in (0.0, 1e-9, 0.4, 0.6, 5.0):
        b = a + d
        exact = np.exp(a) if d == 0 else np.exp(a) * np.expm1(d) / d
        assert np.allclose(divided_difference(np.exp, np.exp, a, b), exact, rtol=1e-13)
