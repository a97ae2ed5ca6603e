"""Refined instrumental variables, the order-4 variational PEM and n4sid with a linear match."""

import numpy as np
import pytest

from sysid_bench import conf
from sysid_bench.build import build
from sysid_bench.mechanics.fisher import crlb
from sysid_bench.methods.mdk_srivc import MdkSrivc
from sysid_bench.methods.n4sid_frf import N4sidFrf
from sysid_bench.methods.variational_gauss2 import VariationalGauss2
from sysid_bench.nouns import Model, NotApplicable, Sampling
from sysid_bench.score import relative_error


def acquired(h: float, snr_db: float | None, N: int = 6000, seed: int = 1, plant_name: str = "three_dof"):
    parts = {
        name: build(conf.option(*name)) for name in (("plant", plant_name), ("excitation", "cubic_noise"))
    }
    plant, excitation = parts.values()
    noise = build({**conf.option("noise", "white"), "snr_db": 300.0 if snr_db is None else snr_db})
    source = build(conf.option("source", "simulation"))
    return plant, source.acquire(plant, excitation, noise, Sampling(h, N), np.random.default_rng(seed))


def errors(estimate, plant) -> np.ndarray:
    pairs = ((estimate.M, plant.mass), (estimate.D, plant.damping), (estimate.K, plant.stiffness))
    return np.array([relative_error(got, truth) for got, truth in pairs])


def over_bound(method, h: float, runs: int) -> np.ndarray:
    ratios = []
    for seed in range(runs):
        plant, got = acquired(h, 15.0, seed=seed)
        bound = crlb(plant, got.record, got.noise_variance)
        ratios.append(errors(method.fit(got.record, Model(n=3)), plant) / [bound.M, bound.D, bound.K])
    return np.sqrt(np.mean(np.square(ratios), axis=0))


def test_instrumental_variables_are_near_the_bound() -> None:
    assert np.all(over_bound(MdkSrivc(), 0.1, 6) < 1.7)


def test_instrumental_variables_know_their_limits() -> None:
    _, got = acquired(0.1, 15.0, N=600)
    with pytest.raises(NotApplicable, match="sensor"):
        record = got.record.__class__(got.record.t, got.record.u, got.record.y[:, :2], "cubic")
        MdkSrivc().fit(record, Model(n=3, output_map=np.eye(3)[:2]))


def test_gauss2_has_the_bias_of_an_order_4_scheme() -> None:
    """Deterministic: no noise, cubic spline input; M, D, K bias at two steps."""
    plant, coarse = acquired(0.5, None)
    _, fine = acquired(0.25, None)
    method = VariationalGauss2(start="nominal")
    large, small = (errors(method.fit(a.record, plant.model()), plant) for a in (coarse, fine))
    assert np.all(large < 0.01) and np.all(small < 6e-4)
    assert np.all((large / small > 8) & (large / small < 30))


def test_gauss2_finds_its_own_start() -> None:
    plant, got = acquired(0.1, 15.0)
    assert np.all(errors(VariationalGauss2().fit(got.record, Model(n=3)), plant) < 0.05)


def test_the_fair_n4sid_is_within_a_few_bounds() -> None:
    for h in (0.1, 0.01):
        assert np.all(over_bound(N4sidFrf(), h, 4) < 3.5)
