"""The simulation with effects against scipy's adaptive integrators on laws written again here."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from sysid_bench.effects import effect, names
from sysid_bench.mechanics.assembly import assemble
from sysid_bench.mechanics.nonlinear import simulate
from sysid_bench.mechanics.stages import spline_values, stage_values
from sysid_bench.mechanics.stepper import Stepper
from sysid_bench.nouns import Plant

H, N = 0.1, 400
ONE = dict(mass=[[1.0]], damping=[[0.3]], stiffness=[[1.5]])
TWO = dict(
    mass=[[1.0, 0], [0, 2.0]], damping=[[0.3, -0.1], [-0.1, 0.3]], stiffness=[[4.0, -1.5], [-1.5, 5.0]],
    input_map=[[1.0], [0.0]],
)  # fmt: skip


def noise(rng, nu=1):
    return np.repeat(rng.normal(size=(N // 5, nu)), 5, axis=0) * 2.0


def adaptive(plant, u, law, hold="zoh", z0=(), rate=None, c=None, method="DOP853"):
    """q (N, n) with an adaptive integrator, restarted at every sample; `law(x, v, t, z)` is the force."""
    n = plant.n
    c = np.eye(n)[0] if c is None else np.asarray(c, float)
    inverse = np.linalg.inv(plant.mass)
    spline = CubicSpline(np.arange(N) * H, u)
    state = np.concatenate([np.zeros(2 * n), z0])
    out = [state]

    def rhs(t, s, k):
        q, v, z = s[:n], s[n : 2 * n], s[2 * n :]
        w = u[k] if hold == "zoh" else spline(t)
        f = plant.input_map @ w - plant.damping @ v - plant.stiffness @ q - c * law(c @ q, c @ v, t, z)
        return np.concatenate([v, inverse @ f, rate(c @ q, c @ v, t, z) if rate else []])

    for k in range(N - 1):
        s = solve_ivp(rhs, (k * H, (k + 1) * H), state, method, args=(k,), rtol=1e-9, atol=1e-11)
        state = s.y[:, -1]
        out.append(state)
    return np.array(out)[:, :n]


def bouc_wen(x, v, t, z):
    return [v * (1 - (0.6 * np.sign(v * z[0]) + 0.4) * abs(z[0] / 0.5))]


CASES = {
    "cubic_stiffness": ({"stiffness": 0.4}, lambda x, v, t, z: 0.4 * x**3, {}, 1e-4),
    "quadratic_drag": ({"coefficient": 0.5}, lambda x, v, t, z: 0.5 * abs(v) * v, {}, 1e-4),
    "dead_zone": ({"stiffness": 0.7, "gap": 0.5}, lambda x, v, t, z: -0.7 * np.clip(x, -0.5, 0.5), {}, 1e-4),
    "coulomb_friction": ({"force": 0.5, "speed": 0.02}, lambda x, v, t, z: 0.5 * np.tanh(v / 0.02), {"method": "LSODA"}, 2e-3),
    "end_stop": ({"stiffness": 60.0, "gap": 0.8, "side": 1.0}, lambda x, v, t, z: 60 * max(x - 0.8, 0), {}, 2e-3),
    "bouc_wen_hysteresis": (
        {"stiffness": 1.2, "yield_displacement": 0.5, "shape": 0.6},
        lambda x, v, t, z: 1.2 * z[0],
        {"z0": [0.0], "rate": bouc_wen},
        1e-3,
    ),
    "time_varying_stiffness": (
        {"slope": 0.02, "amplitude": 0.3, "frequency": 0.2},
        lambda x, v, t, z: (0.02 * t + 0.3 * np.sin(0.4 * np.pi * t)) * x,
        {},
        1e-4,
    ),
    "position_ripple": ({"amplitude": 0.3, "pitch": 0.4}, lambda x, v, t, z: -0.3 * np.sin(2 * np.pi * x / 0.4), {}, 1e-3),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("hold", ["zoh", "cubic"])
def test_the_simulation_agrees_with_an_adaptive_integrator(name, hold):
    parameters, law, options, tolerance = CASES[name]
    plant = Plant(**ONE, effects=(effect(name, 0, parameters),))
    u = noise(np.random.default_rng(3))
    q = simulate(plant, u, H, hold, substeps=16).q
    exact = adaptive(plant, u, law, hold, **options)
    assert np.abs(q - exact).max() < tolerance * np.abs(exact).max()


def test_a_pair_of_dofs_feels_the_force_with_opposite_signs():
    plant = Plant(**TWO, effects=(effect("cubic_stiffness", (0, 1), {"stiffness": 0.8}),))
    u = noise(np.random.default_rng(4))
    exact = adaptive(plant, u, lambda x, v, t, z: 0.8 * x**3, c=[1, -1])
    assert np.abs(simulate(plant, u, H, "zoh", substeps=16).q - exact).max() < 1e-4 * np.abs(exact).max()


def test_an_extra_mode_is_one_more_degree_of_freedom():
    plant = Plant(
        **ONE, effects=(effect("extra_mode", 0, {"mass": 0.2, "frequency": 0.3, "damping_ratio": 0.02}),)
    )
    w = 2 * np.pi * 0.3
    k, d = 0.2 * w**2, 0.2 * 2 * 0.02 * w
    big = Plant(
        [[1.0, 0], [0, 0.2]], [[0.3 + d, -d], [-d, d]], [[1.5 + k, -k], [-k, k]], input_map=[[1.0], [0.0]],
    )  # fmt: skip
    u = noise(np.random.default_rng(5))
    assert simulate(plant, u, H, "zoh").q == pytest.approx(simulate(big, u, H, "zoh").q[:, :1], abs=1e-12)


def test_friction_that_holds_does_not_creep():
    plant = Plant(**ONE, effects=(effect("coulomb_friction", 0, {"force": 1.0}),))
    q = simulate(plant, np.full((N, 1), 0.5), H, "zoh").q
    assert np.abs(q).max() < 0.01 * 0.5 / 1.5


def test_one_step_at_a_time_is_the_whole_simulation():
    effects = tuple(
        effect(name, 0, p)
        for name, p in {
            "backlash": {"stiffness": 0.5, "gap": 0.2}, "input_delay": {"delay": 0.13}, "actuator_lag": {"time_constant": 0.3},
        }.items()
    )  # fmt: skip
    plant = Plant(**ONE, effects=effects)
    u = noise(np.random.default_rng(6))
    stepper = Stepper(plant, H, substeps=8)
    one_by_one = [stepper.measure(), *(stepper.step(row) for row in u[:-1])]
    assert np.array(one_by_one) == pytest.approx(simulate(plant, u, H, "zoh").y, abs=1e-12)


def test_a_delay_of_whole_samples_shifts_the_input():
    plant = Plant(**ONE, effects=(effect("input_delay", 0, {"delay": 3 * H}),))
    u = noise(np.random.default_rng(7))
    late = np.concatenate([np.zeros((3, 1)), u[:-3]])
    assert simulate(plant, u, H, "zoh").q == pytest.approx(
        simulate(Plant(**ONE), late, H, "zoh").q, abs=1e-10
    )


def test_the_spline_is_not_a_knot():
    u = np.random.default_rng(8).normal(size=(50, 2))
    fine = CubicSpline(np.arange(50), u)(np.arange(49 * 4 + 1) / 4)
    assert spline_values(u, 4) == pytest.approx(fine, abs=1e-12)


def test_a_periodic_input_is_read_from_its_fourier_series():
    t = np.arange(120)
    u = np.cos(2 * np.pi * t / 40 + 0.3)[:, None]
    stages = stage_values(u, 1.0, "bandlimited", 5, period=40)
    fine = np.arange(119 * 5) / 5
    assert stages[:, 0, 0] == pytest.approx(np.cos(2 * np.pi * fine / 40 + 0.3), abs=1e-10)


@pytest.mark.parametrize("name", names())
def test_every_effect_simulates_and_changes_the_motion_or_the_measurement(name):
    u = noise(np.random.default_rng(9))
    dof = (0, 1) if name == "missing_coupling" else 0
    special = {
        "time_varying_stiffness": {"amplitude": 0.5, "frequency": 0.1},
        "saturation": {"limit": 1.0},
        "sensor_clipping": {"limit": 0.3},
    }
    plant = Plant(**TWO, effects=(effect(name, dof, special.get(name)),))
    y, plain = simulate(plant, u, H, "zoh").y, simulate(Plant(**TWO), u, H, "zoh").y
    assert np.isfinite(y).all() and np.abs(y - plain).max() > 1e-6


@pytest.mark.parametrize(
    "name", ["bouc_wen_hysteresis", "stribeck_friction", "structural_damping", "presliding_friction"]
)
def test_derivatives_of_the_trajectory_agree_with_differences(name):
    from sysid_bench.gap.sensitivity import derivatives, variables

    def run(values, mass, extra=0.0):
        plant = Plant([[mass, 0], [0, 2.0]], TWO["damping"], TWO["stiffness"], input_map=TWO["input_map"], effects=(base.with_values(values), other))  # fmt: skip
        from sysid_bench.mechanics.trajectory import trajectory

        return trajectory(assemble(plant), stage_values(u, H, "zoh", 4), H, 4, np.array([extra, 0, 0, 0]))

    u = noise(np.random.default_rng(10))
    smooth = {"speed": 0.05} if name == "stribeck_friction" else {}
    base, other = effect(name, 0, smooth), effect("cubic_stiffness", (0, 1), {"stiffness": 0.5})
    keys = list(base.numeric)
    chosen = [k for k in range(len(keys)) if keys[k] not in ("speed", "frequency")]
    p = base.values
    J = derivatives(run(p, 1.0), variables(entries=[(0, 0, 0)], parameters=chosen, states=[0]), np.eye(2, 4))
    for column, k in enumerate(chosen, start=1):
        step = 1e-4 * np.eye(len(p))[k] * max(abs(p[k]), 1e-3)
        difference = (run(p + step, 1.0).X - run(p - step, 1.0).X)[::4, :2] / (2 * step[k])
        error = np.linalg.norm(J[:, column].T - difference) / np.linalg.norm(difference)
        assert error < 0.02, (keys[k], error)
    difference = (run(p, 1.0001).X - run(p, 0.9999).X)[::4, :2] / 2e-4
    assert np.linalg.norm(J[:, 0].T - difference) < 0.02 * np.linalg.norm(difference)
    difference = (run(p, 1.0, 1e-4).X - run(p, 1.0, -1e-4).X)[::4, :2] / 2e-4
    assert np.linalg.norm(J[:, -1].T - difference) < 0.05 * np.linalg.norm(difference)
