"""Cramer-Rao bounds: against the brute-force formula, the prototype's figures, and what cannot be identified."""

from dataclasses import replace

import numpy as np
import pytest
from test_second_order import plant

from sysid_bench.excitations.cubic_noise import CubicNoise
from sysid_bench.mechanics.fisher import crlb, derivatives
from sysid_bench.mechanics.modal import sensitivity
from sysid_bench.mechanics.second_order import companion, ntheta, pack, poles, unpack
from sysid_bench.mechanics.simulate import simulate
from sysid_bench.noises.white import White
from sysid_bench.nouns import InputError, Plant, Record, Sampling
from sysid_bench.sources.simulation import Simulation


def acquired(name, h, N=6000, snr_db=15.0, Ta=1.0, seed=0, source=None):
    source = source or Simulation()
    return source.acquire(
        plant(name), CubicNoise(Ta), White(snr_db), Sampling(h, N), np.random.default_rng(seed)
    )


def bound(name, h, **options):
    run = acquired(name, h, **options)
    return crlb(plant(name), run.record, run.noise_variance)


@pytest.mark.parametrize(
    ("h", "percent"), [(1.0, (0.64, 1.06, 0.64)), (0.125, (0.64, 1.06, 0.64)), (0.02, (0.69, 1.14, 0.69))]
)
def test_three_dof_bounds_are_the_published_ones(h, percent):
    found = bound("three_dof", h)
    assert np.allclose([100 * found.M, 100 * found.D, 100 * found.K], percent, rtol=0.12)


@pytest.mark.parametrize(("snr_db", "percent"), [(20, (0.85, 2.58, 0.81)), (8, (3.4, 10.4, 3.2))])
def test_eight_dof_bounds_are_the_published_ones(snr_db, percent):
    found = bound("eight_dof", 0.025, Ta=0.1, snr_db=snr_db)
    assert np.allclose([100 * found.M, 100 * found.D, 100 * found.K], percent, rtol=0.1)


@pytest.mark.parametrize("start", ["free", "known"])
def test_the_bound_is_that_of_the_full_jacobian(start):
    p, run = plant("three_dof"), acquired("three_dof", 0.25, N=300)
    parts = (p.mass, p.damping, p.stiffness, p.input_map, p.output_map, p.output)
    J = sensitivity(*parts, run.record.u, 0.25, "cubic").jacobian() / np.sqrt(run.noise_variance)[:, None]
    J = J.reshape(-1, J.shape[2])[:, : None if start == "free" else ntheta(3)]
    covariance = np.linalg.pinv(J.T @ J)[: ntheta(3), : ntheta(3)]
    found = crlb(p, run.record, run.noise_variance, start)
    assert np.allclose(found.covariance, covariance, rtol=1e-6, atol=1e-9 * np.abs(covariance).max())
    rng = np.random.default_rng(0)
    draws = rng.multivariate_normal(np.zeros(18), covariance, size=4000)
    squares = [np.mean([np.sum(X**2) for X in group]) for group in zip(*(unpack(d, 3) for d in draws))]
    norms = [np.linalg.norm(X) for X in (p.mass, p.damping, p.stiffness)]
    assert np.allclose([found.M, found.D, found.K], np.sqrt(squares) / norms, rtol=0.05)


@pytest.mark.parametrize("name", ["one_dof", "one_dof_overdamped", "three_dof", "eight_dof"])
def test_slopes_of_A_and_of_the_poles(name):
    p = plant(name)
    theta, (slopes, lam, pole_slopes) = (
        pack(p.mass, p.damping, p.stiffness),
        derivatives(p.mass, p.damping, p.stiffness),
    )
    assert np.allclose(lam, poles(p.mass, p.damping, p.stiffness))
    for k in (0, len(theta) // 2, len(theta) - 1):
        e = np.zeros(len(theta))
        e[k] = 1e-4 * max(abs(theta[k]), np.abs(theta).max() * 1e-3)
        ends = [unpack(theta + s * e, p.n) for s in (1, -1)]
        assert np.allclose(
            slopes[k], (companion(*ends[0]) - companion(*ends[1])) / (2 * e[k]), rtol=1e-6, atol=1e-9
        )
        expected = (poles(*ends[0]) - poles(*ends[1])) / (2 * e[k])
        assert np.allclose(pole_slopes[k], expected, rtol=1e-4, atol=1e-6 * np.abs(pole_slopes[k]).max())


def test_more_noise_shorter_records_and_free_states_cost_what_they_must():
    p, run = plant("three_dof"), acquired("three_dof", 0.25, N=400)
    base = crlb(p, run.record, run.noise_variance)
    assert np.isclose(crlb(p, run.record, 4 * run.noise_variance).M, 2 * base.M)
    assert crlb(p, run.record, run.noise_variance, "known").D < base.D
    flagged = replace(run.record, quality=np.arange(400) % 2)
    assert 1.2 < crlb(p, flagged, run.noise_variance).K / base.K < 1.7
    only_K = np.arange(18) >= 12
    assert crlb(p, run.record, run.noise_variance, free=only_K).M == 0
    assert crlb(p, run.record, run.noise_variance, free=only_K).K < base.K


def test_the_bound_takes_the_initial_state_from_the_record():
    p, h, x0 = plant("three_dof"), 0.1, np.array([1.0, -2.0, 0.5, 3.0, 0.0, -1.0])
    u = CubicNoise(1.0).signal(200, h, 3, np.random.default_rng(0)).u
    record = Record(h * np.arange(200), u, simulate(p, u, h, "cubic", x0), hold="cubic")
    told, fitted, rest = (crlb(p, record, 1e-4 * np.ones(3), x0=x) for x in (x0, None, np.zeros(6)))
    assert np.isclose(told.M, fitted.M, rtol=1e-9) and rest.M > 1.05 * told.M


@pytest.mark.parametrize("name", ["one_dof_undamped", "one_dof_critical"])
def test_awkward_plants_have_a_bound(name):
    found = bound(name, 0.25, N=500)
    assert 0 < found.M < 0.1 and 0 < found.D < 0.1 and 0 < found.K < 0.1
    assert np.isnan(found.pole) if name == "one_dof_critical" else 0 < found.pole < 0.1


def test_partly_sensed_and_driven_plants():
    p = plant("three_dof")
    p = Plant(p.mass, p.damping, p.stiffness, input_map=np.eye(3)[:, :1], output_map=np.eye(3)[:1])
    u = CubicNoise(1.0).signal(1000, 0.25, 1, np.random.default_rng(1)).u
    record = Record(0.25 * np.arange(1000), u, simulate(p, u, 0.25, "cubic"), hold="cubic")
    with pytest.raises(np.linalg.LinAlgError, match="determine"):
        crlb(p, record, np.ones(1))
    chain = np.array([[True, False, False], [False, True, False], [False, False, True]])
    diagonal = np.concatenate([chain[np.triu_indices(3)], np.zeros(12, bool)])
    assert crlb(p, record, np.ones(1), free=diagonal).M > 0


def test_refusals():
    run = acquired("one_dof", 0.5, N=50)
    with pytest.raises(InputError, match="hold"):
        crlb(plant("one_dof"), replace(run.record, hold=None), run.noise_variance)
    still = replace(run.record, u=np.zeros((50, 1)), y=np.zeros((50, 1)))
    with pytest.raises(np.linalg.LinAlgError, match="no influence"):
        crlb(plant("one_dof"), still, run.noise_variance)
