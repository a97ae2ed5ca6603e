"""Analytic sensitivities against finite differences, for every rule, output, and awkward plant."""

import numpy as np
import pytest
from test_second_order import plant

from sysid_bench.excitations.cubic_noise import CubicNoise
from sysid_bench.mechanics.holds import propagate
from sysid_bench.mechanics.modal import sensitivity
from sysid_bench.mechanics.second_order import modes, ntheta, pack, state_space, unpack
from sysid_bench.mechanics.simulate import simulate
from sysid_bench.nouns import Plant

HOLDS = ["zoh", "foh", "cubic", "bandlimited", "cayley", "gauss2"]
REPEATED = Plant(np.eye(2), 0.1 * np.eye(2), 2 * np.eye(2))
RIGID = Plant(np.diag([1.0, 2.0]), [[0.2, -0.2], [-0.2, 0.2]], [[1.0, -1.0], [-1.0, 1.0]])
PLANTS = {
    "undamped": (plant("one_dof_undamped"), 0.3),
    "under": (plant("one_dof"), 0.3),
    "critical": (plant("one_dof_critical"), 0.3),
    "over": (plant("one_dof_overdamped"), 0.3),
    "three": (plant("three_dof"), 0.2),
    "repeated": (REPEATED, 0.3),
    "rigid": (RIGID, 0.3),
}


def differences(p, L, C, output, u, h, hold, x0):
    """dy/d(theta, x0) by fourth-order central differences of an ordinary simulation."""
    at, count = np.concatenate([pack(p.mass, p.damping, p.stiffness), x0]), ntheta(p.n)

    def y(parameters):
        A, B, Cx, Dx = state_space(*unpack(parameters[:count], p.n), L, C, output)
        return propagate(A, B, u, h, hold, parameters[count:]) @ Cx.T + u @ Dx.T

    steps = 1e-3 * np.maximum(np.abs(at), 0.1)
    columns = []
    for e in np.diag(steps):
        near, far = y(at + e) - y(at - e), y(at + 2 * e) - y(at - 2 * e)
        columns.append((8 * near - far) / (12 * e.sum()))
    return np.stack(columns, axis=2)


def case(p, h, output, N=50):
    """Signals through general L (n, 2) and C (2, n), and an initial state."""
    rng = np.random.default_rng(7)
    L, C, u = rng.normal(size=(p.n, 2)), rng.normal(size=(2, p.n)), rng.normal(size=(N, 2))
    return L, C, output, u, h, rng.normal(size=2 * p.n)


@pytest.mark.parametrize("output", ["displacement", "velocity", "acceleration"])
@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("name", PLANTS)
def test_jacobian_is_that_of_finite_differences(name, hold, output):
    p, h = PLANTS[name]
    L, C, output, u, h, x0 = case(p, h, output)
    if name == "rigid" and hold == "bandlimited":
        u = u - u.mean(axis=0)  # a constant force on a free body has no steady state
    found = sensitivity(p.mass, p.damping, p.stiffness, L, C, output, u, h, hold, x0)
    J, expected = found.jacobian(), differences(p, L, C, output, u, h, hold, x0)
    worst = np.abs(J - expected).max(axis=(0, 1)) / np.abs(expected).max(axis=(0, 1))
    assert worst.max() < 1e-7


def test_eight_dof_jacobian():
    p = plant("eight_dof")
    L, C, output, u, h, x0 = case(p, 0.02, "displacement", N=30)
    J = sensitivity(p.mass, p.damping, p.stiffness, L, C, output, u, h, "cubic", x0).jacobian()
    at, count = pack(p.mass, p.damping, p.stiffness), ntheta(8)
    scale = np.abs(at.reshape(3, -1)).max(axis=1).repeat(count // 3)
    for column in (0, 9, 40, 71, 75, count - 1):
        e = np.zeros(count)
        e[column] = 1e-3 * scale[column]
        y = [sensitivity(*unpack(at + s * e, 8), L, C, output, u, h, "cubic", x0).y for s in (1, -1, 2, -2)]
        expected = (8 * (y[0] - y[1]) - (y[2] - y[3])) / (12 * e.sum())
        assert np.abs(J[:, :, column] - expected).max() < 1e-7 * np.abs(expected).max()


def test_both_paths_are_taken():
    defective = {
        name
        for name, (p, _) in PLANTS.items()
        if modes(state_space(p.mass, p.damping, p.stiffness)[0]).defective
    }
    assert defective == {"critical", "rigid"}


@pytest.mark.parametrize("name", ["under", "critical", "three"])
def test_normal_equations_are_those_of_the_jacobian(name):
    p, h = PLANTS[name]
    L, C, output, u, h, x0 = case(p, h, "velocity")
    found = sensitivity(p.mass, p.damping, p.stiffness, L, C, output, u, h, "foh", x0)
    residual, weights, good = (
        np.random.default_rng(8).normal(size=found.y.shape),
        np.array([2.0, 5.0]),
        np.ones(50, bool),
    )
    good[[3, 17]] = False
    J = found.jacobian() * good[:, None, None]
    H, g = found.normal(residual, weights, good)
    assert np.allclose(H, np.einsum("top,o,toq->pq", J, weights, J), rtol=1e-9)
    assert np.allclose(
        g, np.einsum("top,o,to->p", J, weights, residual), rtol=1e-9, atol=1e-9 * np.abs(g).max()
    )
    assert np.array_equal(found.normal(None, weights, good)[0], H)


def test_the_output_is_that_of_the_simulation():
    p, h = PLANTS["three"]
    L, C, output, u, h, x0 = case(p, h, "acceleration")
    A, B, Cx, Dx = state_space(p.mass, p.damping, p.stiffness, L, C, output)
    found = sensitivity(p.mass, p.damping, p.stiffness, L, C, output, u, h, "cubic", x0)
    assert np.array_equal(found.y, propagate(A, B, u, h, "cubic", x0) @ Cx.T + u @ Dx.T)


@pytest.mark.parametrize("excess", [1e-4, 1e-6, 1e-8, 1e-10, -1e-5, -1e-9])
def test_nearly_critical_damping_costs_no_accuracy(excess):
    """Around the switch from the modal form to the cascade both must say the same as finite differences."""
    p = Plant([[1.0]], [[2.0 + excess]], [[1.0]])
    L, C, output, u, h, x0 = case(p, 0.3, "displacement")
    J = sensitivity(p.mass, p.damping, p.stiffness, L, C, output, u, h, "cubic", x0).jacobian()
    expected = differences(p, L, C, output, u, h, "cubic", x0)
    assert np.abs(J - expected).max() < 1e-7 * np.abs(expected).max()


BIAS = {  # relative errors of M, D, K when h = 0.25 s spline data without noise are fitted under another rule
    "cayley": (0.0527, 0.0218, 0.0295),
    "foh": (0.0115, 0.0216, 0.0149),
    "zoh": (0.040, 0.072, 0.011),
    "gauss2": (0.00020, 0.00019, 0.00010),
    "cubic": (0.0, 0.0, 0.0),
}


@pytest.mark.parametrize("hold", BIAS)
def test_gauss_newton_finds_the_known_bias_of_each_rule(hold):
    p, h = plant("three_dof"), 0.25
    u = CubicNoise(1.0).signal(6000, h, 3, np.random.default_rng(0)).u
    y, theta, x0 = simulate(p, u, h, "cubic"), pack(p.mass, p.damping, p.stiffness), np.zeros(6)
    for _ in range(6):
        parts = (*unpack(theta, 3), p.input_map, p.output_map, p.output)
        at = sensitivity(*parts, u, h, hold, x0)
        H, g = at.normal(y - at.y, 1 / y.var(axis=0))
        scale = 1 / np.sqrt(np.diag(H))
        step = scale * np.linalg.solve(H * np.outer(scale, scale), scale * g)
        theta, x0 = theta + step[:18], x0 + step[18:]
    truth = (p.mass, p.damping, p.stiffness)
    errors = [np.linalg.norm(X - Y) / np.linalg.norm(Y) for X, Y in zip(unpack(theta, 3), truth)]
    assert np.allclose(errors, BIAS[hold], rtol=0.4 if hold == "zoh" else 0.1, atol=1e-11)
