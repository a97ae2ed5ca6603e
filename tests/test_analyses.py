"""Analyses against what is known without them: closed forms, limits, certificates."""

import numpy as np
import pytest

from sysid_bench import conf
from sysid_bench.analyses.arx_response import ArxResponse
from sysid_bench.analyses.conversion_error import ConversionError, inverse_zoh, kappa, kappa_printed, lumped
from sysid_bench.analyses.efficiency import Efficiency
from sysid_bench.analyses.energy import Energy
from sysid_bench.analyses.identifiability import Identifiability
from sysid_bench.analyses.passivity import Passivity
from sysid_bench.analyses.simulation_error import SimulationError
from sysid_bench.build import build
from sysid_bench.mechanics.conversion import c2d_zoh
from sysid_bench.mechanics.integrators import RULES, one_step
from sysid_bench.mechanics.second_order import companion, input_matrix
from sysid_bench.nouns import InputError, Plant, Sampling

K3 = np.array([[4.0, -1, -1], [-1, 4, -1], [-1, -1, 4]])
THREE = Plant(np.diag([0.8, 2.0, 1.2]), K3 / 10, K3)
FALL_T = np.pi / np.sqrt(0.75)


def scalar(c, m=1.0, k=1.0):
    return Plant([[m]], [[c]], [[k]])


def rng():
    return np.random.default_rng(1)


def compute(analysis, plant, h=0.1, N=100):
    return analysis.compute(plant, Sampling(h, N), rng())


# conversion error --------------------------------------------------------------------------------------------


def test_kappa_has_all_three_singular_values():
    assert kappa(2.0) == pytest.approx(2.0)
    assert kappa_printed(2.0) == pytest.approx(np.sqrt(2))
    for h in (0.01, 0.1, 1.2, 3.3):
        assert kappa_printed(h) == pytest.approx(kappa(h), rel=1e-6)


def test_kappa_grows_as_the_inverse_square():
    assert kappa(1e-3) / kappa(1e-2) == pytest.approx(100, rel=1e-4)
    assert kappa(1e-3) * 1e-6 == pytest.approx(3 * np.sqrt(2), rel=1e-4)


def test_unperturbed_zoh_comes_back():
    A, b = np.array([[0.0, 1.0], [-3.0, -0.5]]), np.array([0.0, 0.5])
    F, G = c2d_zoh(A, b[:, None], 0.3)
    As, bs = inverse_zoh(F[None], G[None, :, 0], 0.3)
    assert np.allclose(As[0], A, atol=1e-12) and np.allclose(bs[0], b, atol=1e-12)
    assert lumped(As, bs)[0] == pytest.approx([2.0, 1.0, 6.0])


def test_a_model_without_logarithm_is_left_out():
    F = np.array([np.diag([-0.5, 0.5]), np.diag([0.4, 0.5])])
    As, _ = inverse_zoh(F, np.ones((2, 2)), 0.1)
    assert len(As) == 1 and np.allclose(As[0], np.diag(np.log([0.4, 0.5])) / 0.1)


def test_midpoint_errors_follow_h():
    slow, fast = (compute(ConversionError("midpoint", ratio), scalar(0.2)) for ratio in (20, 100))
    assert slow["h_s"] / fast["h_s"] == pytest.approx(5)
    assert [fast[f"{x}_error"] / slow[f"{x}_error"] for x in "mdk"] == pytest.approx([1, 5, 25], rel=0.1)


def test_zoh_errors_follow_the_logarithm():
    slow, fast = (compute(ConversionError("zoh", ratio), scalar(0.2)) for ratio in (20, 100))
    assert fast["A_error"] / slow["A_error"] == pytest.approx(
        fast["inverse_log_norm"] / slow["inverse_log_norm"], rel=0.1
    )


@pytest.mark.parametrize("settings", [{"rule": "euler"}, {"sampling_ratio": 0.0}])
def test_conversion_refuses(settings):
    with pytest.raises(InputError, match=next(iter(settings))):
        ConversionError(**settings)


def test_conversion_refuses_larger_plants():
    with pytest.raises(InputError, match="one degree of freedom"):
        compute(ConversionError(), THREE)


# passivity and energy ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("h", [0.01, 0.1, 0.5])
@pytest.mark.parametrize(
    ("rule", "output", "passive"),
    [
        ("midpoint", "averaged", 1),
        ("midpoint", "increment", 1),
        ("midpoint", "sampled", 0),
        ("zoh", "sampled", 0),
        ("zoh", "increment", 1),
    ],
)
def test_passivity(rule, output, passive, h):
    found = compute(Passivity(rule, output), THREE, h)
    assert found["passive"] == passive
    if passive:
        assert found["lmi"] < 1e-12 and found["margin"] > -1e-12
    else:
        assert found["margin"] < -1e-4


def test_the_unscaled_energy_does_not_solve_the_discrete_inequality():
    assert compute(Passivity("midpoint", "averaged"), THREE, 0.1)["lmi_printed"] > 1e-3


def test_an_active_plant_is_not_called_passive():
    """Negative damping: the certificate must fail, and the frequency test must find it."""
    assert compute(Passivity("midpoint", "averaged"), scalar(-0.2), 0.1)["passive"] != 1


def test_midpoint_conserves_energy_and_balances_work():
    found = compute(Energy("midpoint"), THREE, 0.1, 10_000)
    assert found["swing"] < 1e-11 and found["balance"] < 1e-13


def test_verlet_oscillates_and_explicit_euler_grows():
    assert 1e-4 < compute(Energy("verlet"), THREE, 0.1, 5000)["swing"] < 0.05
    assert compute(Energy("explicit_euler"), THREE, 0.1, 500)["drift"] > 1
    assert compute(Energy("implicit_euler"), THREE, 0.1, 500)["drift"] < -0.9


def test_the_discrete_lagrangian_gives_the_energy_with_a_minus():
    assert compute(Energy("midpoint"), THREE, 0.1, 300)["lagrangian"] < 1e-8


@pytest.mark.parametrize(
    ("rule", "order"), [("midpoint", 3), ("verlet", 3), ("explicit_euler", 2), ("implicit_euler", 2)]
)
def test_one_step_has_its_order(rule, order):
    A = companion(THREE.mass, 0 * K3, K3)
    B = input_matrix(THREE.mass, np.eye(3))
    error = [np.linalg.norm(one_step(rule, A, B, h)[0] - one_step("zoh", A, B, h)[0]) for h in (0.02, 0.01)]
    assert np.log2(error[0] / error[1]) == pytest.approx(order, abs=0.1)


def test_one_step_refuses():
    with pytest.raises(InputError, match=RULES[0]):
        one_step("leapfrog", np.eye(2), np.eye(2), 0.1)


# difference equations ----------------------------------------------------------------------------------------


def test_cancellation_at_half_a_period():
    at = compute(Identifiability(), scalar(1.0), FALL_T, 44)
    assert at["condition"] > 1e14 and at["b1_share"] < 1e-12
    assert at["pole_zero_distance"] < 1e-7 and at["zero"] == pytest.approx(-np.exp(-FALL_T / 2))
    assert compute(Identifiability(), scalar(1.0), 1.0, 44)["condition"] < 10


def test_undamped_cancellation_is_narrow():
    conditions = [compute(Identifiability(), scalar(0.0), T, 44)["condition"] for T in (3.0, 3.14, 3.3)]
    assert conditions[1] > 1e4 and max(conditions[0], conditions[2]) < 100


def test_fine_converter_gives_the_plant():
    found = compute(ArxResponse(bits=30), scalar(1.0), 0.5, 44)
    assert max(found[name] for name in ("residual", "simulation", "sine")) < 1e-6
    assert found["higher_terms"] == 0 and found["stable"] == 1


def test_twelve_bits_follow_sines_up_to_resonance():
    errors = [
        ArxResponse().compute(scalar(1.0), Sampling(1.0, 44), np.random.default_rng(s))["sine"]
        for s in range(20)
    ]
    assert np.median(errors) < 0.02


def test_arx_response_refuses_short_records():
    with pytest.raises(InputError, match="at least 10 samples"):
        compute(ArxResponse(order=3), scalar(1.0), 0.5, 9)


# simulation --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("h", [1.0, 0.5, 0.1])
def test_spline_hold_is_exact_for_smooth_forces(h):
    found = compute(SimulationError("cubic"), THREE, h, int(60 / h) + 1)
    assert found["error"] < 1e-11 and found["spline"] < 1e-12


@pytest.mark.parametrize(("rule", "order"), [("zoh", 1), ("foh", 2), ("cayley", 2), ("gauss2", 4)])
def test_simulation_order(rule, order):
    coarse, fine = (compute(SimulationError(rule), THREE, h, int(100 / h) + 1)["error"] for h in (0.1, 0.05))
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.15)


def test_simulation_refuses_steps_that_do_not_divide_the_knots():
    with pytest.raises(InputError, match="must divide"):
        compute(SimulationError(), THREE, 0.3)


def test_a_wrong_maximum_is_not_confirmed_by_the_same_start():
    """The record on which no instrumental step gains: both linear starts are one, and lead to a wrong maximum."""
    plant = build(conf.option("plant", "eight_dof"))
    found = Efficiency(knot_spacing_s=0.1, zeta=0.0).compute(
        plant, Sampling(0.0125, 6000), np.random.default_rng(234544415140794850)
    )
    assert found["worst_over_bound"] < 2
