"""A method whose own bias is larger than the noise's error says so, and only then."""

from __future__ import annotations

import numpy as np
import pytest
from identification import ONE_DOF, THREE_DOF, covered, model_of, simulated, smooth

from sysid_bench.mechanics.second_order import pack
from sysid_bench.methods.arx import Arx
from sysid_bench.methods.n4sid import N4sid
from sysid_bench.methods.variational_gauss2 import VariationalGauss2
from sysid_bench.methods.variational_pem import VariationalPem


def record(h: float, snr_db: float = 20.0, plant=THREE_DOF, N: int = 3000, knots_s: float = 1.0):
    rng = np.random.default_rng(1)
    return simulated(plant, smooth(N, h, knots_s, len(plant[0]), rng), h, "cubic", snr_db, rng)


@pytest.mark.parametrize(
    ("method", "biased_h", "fine_h", "key"),
    [
        (VariationalPem(), 0.25, 0.02, "midpoint_bias_over_std"),
        (VariationalGauss2(), 1.0, 0.125, "gauss2_bias_over_std"),
        (N4sid(horizon_s=2.0), 0.25, None, "hold_bias_over_std"),
    ],
    ids=["variational_pem", "variational_gauss2", "n4sid"],
)
def test_a_bias_above_the_noise_is_said(method, biased_h, fine_h, key):
    biased = method.fit(record(biased_h), model_of(THREE_DOF)).diagnostics
    assert biased[key] > 1 and "bias" in biased["warning"] and "spline_ml" in biased["warning"]
    if fine_h is not None:
        fine = method.fit(record(fine_h), model_of(THREE_DOF)).diagnostics
        assert fine[key] < 1 and not fine.get("warning")


def test_the_interval_of_the_gauss_rule_counts_its_bias():
    counted, plain = (
        VariationalGauss2(bias_in_interval=on).fit(record(1.0, 30.0), model_of(THREE_DOF))
        for on in (True, False)
    )
    assert covered([plain], THREE_DOF, pack).mean() < 0.5 < 0.8 < covered([counted], THREE_DOF, pack).mean()
    assert "do not count" in plain.diagnostics["warning"]


def test_a_horizon_short_beside_the_period_is_said():
    short = N4sid(horizon=8).fit(record(0.02), model_of(THREE_DOF)).diagnostics["warning"]
    assert "horizon of 0.16 s" in short
    assert "horizon" not in N4sid(horizon_s=2.0).fit(record(0.1), model_of(THREE_DOF)).diagnostics["warning"]


def test_least_squares_biased_by_output_noise_says_so():
    noisy = Arx(recover="least_squares").fit(record(0.25, 15.0, ONE_DOF), model_of(ONE_DOF)).diagnostics
    assert noisy["noise_bias_over_std"] > 1 and "do not count" in noisy["warning"]
    assert not Arx().fit(record(0.25, 15.0, ONE_DOF), model_of(ONE_DOF)).diagnostics.get("warning")
