"""Standard errors of poles, natural frequencies and damping ratios: right slopes, and intervals that hold the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identification import ONE_DOF, THREE_DOF, UNEVEN, covered, simulated, smooth

from sysid_bench.mechanics.second_order import frequencies_and_damping, ntheta, pack, poles, unpack
from sysid_bench.mechanics.uncertainty import modal_uncertainty, pole_slopes, uncertainty_of
from sysid_bench.methods.spline_ml import SplineML
from sysid_bench.nouns import Estimate, Model

OVERDAMPED = (np.eye(2), np.array([[5.0, -1.0], [-1.0, 0.3]]), np.array([[2.0, -0.5], [-0.5, 3.0]]))


def differences(plant, function, size=1e-6) -> np.ndarray:
    """Central differences of function(M, D, K) to theta, one column each."""
    theta, n = pack(*plant), len(plant[0])
    steps = np.eye(ntheta(n)) * size
    return np.stack(
        [(function(*unpack(theta + s, n)) - function(*unpack(theta - s, n))) / (2 * size) for s in steps],
        axis=1,
    )


@pytest.mark.parametrize("plant", [ONE_DOF, THREE_DOF, UNEVEN, OVERDAMPED])
def test_slopes_are_those_of_differences(plant):
    assert np.allclose(pole_slopes(*plant)[1], differences(plant, poles), atol=1e-6)


@pytest.mark.parametrize("plant", [UNEVEN, OVERDAMPED])
def test_covariances_of_frequencies_and_damping_are_those_of_differences(plant):
    root = np.random.default_rng(0).standard_normal((ntheta(len(plant[0])),) * 2)
    found = modal_uncertainty(*plant, root @ root.T)
    J = differences(plant, lambda *X: np.concatenate(frequencies_and_damping(poles(*X))))
    assert np.allclose(found.covariance, J @ root @ root.T @ J.T, rtol=1e-4, atol=1e-4)
    assert np.allclose(
        np.concatenate([found.omega_n, found.zeta]), np.r_[frequencies_and_damping(poles(*plant))]
    )


def test_intervals_of_matrices_frequencies_and_damping_hold_the_truth():
    rng = np.random.default_rng(3)
    u = smooth(1500, 0.25, 1.0, 3, rng)
    exact = simulated(UNEVEN, u, 0.25, "cubic")
    truth = np.concatenate(frequencies_and_damping(poles(*UNEVEN)))
    inside, estimates = [], []
    for _ in range(150):
        noise = rng.standard_normal(exact.y.shape) * exact.y.std(axis=0) * 10 ** (-15 / 20)
        estimates.append(SplineML().fit(replace(exact, y=exact.y + noise), Model(n=3)))
        found = uncertainty_of(estimates[-1])
        spread = np.concatenate([found.omega_n_std, found.zeta_std])
        inside.append(np.abs(np.concatenate([found.omega_n, found.zeta]) - truth) < 1.96 * spread)
    assert 0.925 < np.mean(inside) < 0.98
    assert 0.925 < covered(estimates, UNEVEN, pack).mean() < 0.98


def test_repeated_poles_have_no_slope_and_what_is_not_told_is_infinite():
    twins = (np.eye(2), 0.1 * np.eye(2), 4.0 * np.eye(2))
    assert np.isnan(modal_uncertainty(*twins, np.eye(9)).omega_n_std).all()
    blind = np.diag([1.0, 1, 1, np.inf, 1, 1, 1, 1, 1])
    assert np.isinf(modal_uncertainty(*OVERDAMPED, blind).omega_n_std).all()
    assert np.isinf(modal_uncertainty(*OVERDAMPED, blind).pole_std.real).all()


def test_only_poles_of_the_matrices_get_their_intervals():
    estimate = Estimate(*UNEVEN, covariance=np.eye(18), poles=poles(*UNEVEN))
    assert uncertainty_of(estimate) is not None
    assert uncertainty_of(replace(estimate, poles=1.01 * estimate.poles)) is None
    assert uncertainty_of(replace(estimate, covariance=None)) is None
