"""Variational integrators of a Lagrangian: orders, energy, exact sensitivities, identification."""

from dataclasses import replace

import numpy as np
import pytest

from sysid_bench.analyses.lagrangian_integrators import LagrangianIntegrators
from sysid_bench.lagrangians.double_pendulum import DoublePendulum
from sysid_bench.lagrangians.duffing import Duffing
from sysid_bench.lagrangians.pendulum import Pendulum
from sysid_bench.mechanics.lagrangian import sensitivities, stage_inputs, stepper, trajectory
from sysid_bench.methods.discrete_lagrangian_pem import DiscreteLagrangianPem
from sysid_bench.nouns import LOST, Diverged, InputError, Model, Plant, Record, Sampling

PLANT = Plant([[1.0]], [[0.1]], [[1.0]])


def motion(system, scheme: str, h: float, N: int, x0: list[float], u: np.ndarray | None = None) -> np.ndarray:
    made = stepper(system, scheme, h)
    u = np.zeros((N, system.nu)) if u is None else u
    theta = np.array(list(system.values().values()))
    return trajectory(made, theta, np.array(x0), stage_inputs(u, "cubic", made.points))


@pytest.mark.parametrize(
    ("system", "q0"), [(Pendulum(damping_N_m_s=0.0), [1.5]), (DoublePendulum(), [0.8, -0.5])]
)
def test_midpoint_is_of_order_2_and_gauss2_of_order_4(system, q0) -> None:
    error = {}
    for h in (0.04, 0.02):
        numbers = LagrangianIntegrators(system, q0, compared_s=3.0).compute(
            PLANT, Sampling(h, round(3 / h) + 1), np.random.default_rng(0)
        )
        for name in ("midpoint", "gauss2"):
            error[name, h] = numbers[f"{name}_error"]
    assert 1.9 < np.log2(error["midpoint", 0.04] / error["midpoint", 0.02]) < 2.1
    assert 3.8 < np.log2(error["gauss2", 0.04] / error["gauss2", 0.02]) < 4.2


def test_energy_stays_where_runge_kutta_loses_it() -> None:
    study = LagrangianIntegrators(Pendulum(damping_N_m_s=0.0), [1.5])
    numbers = study.compute(PLANT, Sampling(0.1, 5000), np.random.default_rng(0))
    assert numbers["midpoint_energy"] < 0.05 and numbers["gauss2_energy"] < 1e-3
    assert numbers["rk4_energy"] > 3 * numbers["gauss2_energy"]


def test_sensitivities_are_those_of_finite_differences() -> None:
    system, N, h = DoublePendulum(), 60, 0.05
    made = stepper(system, "gauss2", h)
    theta = np.array(list(system.values().values()))
    stages = stage_inputs(np.random.default_rng(0).standard_normal((N, 2)), "cubic", made.points)
    x0 = np.array([0.3, -0.4, 0.1, 0.2])
    S = sensitivities(made, theta, trajectory(made, theta, x0, stages), stages)
    p = np.concatenate([theta, x0])
    for k in range(len(p)):
        step = 1e-6 * np.eye(len(p))[k]
        ends = [trajectory(made, (p + s)[:7], (p + s)[7:], stages) for s in (step, -step)]
        assert np.allclose(S[:, :, k], (ends[0] - ends[1]) / 2e-6, rtol=1e-5, atol=1e-6)


def test_a_pendulum_s_free_swings_give_length_and_damping() -> None:
    truth, h, N = Pendulum(length_m=0.8, damping_N_m_s=0.03), 0.02, 1500
    q = motion(truth, "gauss2", h, N, [2.0, 0.0])[:, :1]
    rng = np.random.default_rng(3)
    quality = np.where(rng.random(N) < 0.05, LOST, 0).astype(np.uint8)
    y = q + 0.01 * rng.standard_normal(q.shape)
    y[quality > 0] = np.nan
    record = Record(h * np.arange(N), np.zeros((N, 1)), y, "zoh", quality)
    estimate = DiscreteLagrangianPem(Pendulum(length_m=0.75)).fit(record, Model(n=1))
    for name, value in (("length_m", 0.8), ("damping_N_m_s", 0.03)):
        assert abs(estimate.coefficients[name] - value) < 4 * estimate.coefficients[f"{name}_std"]
    assert estimate.coefficients["length_m_std"] < 1e-3
    with pytest.raises(Diverged, match="does not tell"):
        DiscreteLagrangianPem(Pendulum(length_m=0.75), free=[]).fit(record, Model(n=1))


def test_a_duffing_record_gives_all_four_parameters_back() -> None:
    truth, h, N = Duffing(1.1, 0.15, 1.2, 0.6), 0.1, 600
    u = 2 * np.sin(np.outer(h * np.arange(N), [0.9])) + np.sin(np.outer(h * np.arange(N), [1.7]))
    q = motion(truth, "gauss2", h, N, [0.1, 0.0], u)[:, :1]
    record = Record(h * np.arange(N), u, q, "cubic")
    estimate = DiscreteLagrangianPem(Duffing(), free=[]).fit(record, Model(n=1))
    for name, value in truth.values().items():
        assert np.isclose(estimate.coefficients[name], value, rtol=1e-6)
    midpoint = replace(DiscreteLagrangianPem(Duffing(), free=[]), scheme="midpoint").fit(record, Model(n=1))
    assert not np.isclose(midpoint.coefficients["cubic_stiffness_N_m3"], 0.6, rtol=1e-4)


def test_wrong_names_are_refused_with_those_that_exist() -> None:
    record = Record(0.1 * np.arange(50), np.zeros((50, 1)), np.ones((50, 1)), "zoh")
    with pytest.raises(InputError, match="the system has mass_kg"):
        DiscreteLagrangianPem(Duffing(), free=["mass"]).fit(record, Model(n=1))
