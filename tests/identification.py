"""Plants and records that the tests of the methods share."""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import linear_sum_assignment

from sysid_bench.mechanics.holds import propagate
from sysid_bench.mechanics.second_order import poles, state_space
from sysid_bench.nouns import HOLDS, Model, Record

ONE_DOF = (np.eye(1), 0.2 * np.eye(1), np.eye(1))
K3 = np.array([[4.0, -1, -1], [-1, 4, -1], [-1, -1, 4]])
THREE_DOF = (np.diag([0.8, 2.0, 1.2]), K3 / 10, K3)
# As THREE_DOF, with damping that shares no eigenvectors with M and K.
UNEVEN = (np.diag([0.8, 2.0, 1.2]), np.diag([0.3, 0.5, 0.8]), K3)


def binary(N, nu, seed):
    return np.sign(np.random.default_rng(seed).standard_normal((N, nu)))


def smooth(N, h, Ta, nu, rng):
    """White knots Ta seconds apart, joined by the cubic spline; Ta a multiple of h."""
    every = round(Ta / h)
    knots = rng.standard_normal(((N - 1) // every + 4, nu))
    return CubicSpline(np.arange(len(knots)) * Ta, knots)(np.arange(N) * h)


def simulated(plant, u, h, hold, snr_db=None, rng=None, L=None, C=None, output="displacement", x0=None):
    """The record of M, D, K with white noise at snr_db on each output; hold as in propagate."""
    A, B, Cx, Dx = state_space(*plant, L, C, output)
    y = propagate(A, B, u, h, hold, x0) @ Cx.T + u @ Dx.T
    if snr_db is not None:
        y = y + rng.standard_normal(y.shape) * y.std(axis=0) * 10 ** (-snr_db / 20)
    return Record(np.arange(len(u)) * h, u, y, hold if hold in HOLDS else "zoh")


def model_of(plant, **maps):
    return Model(n=len(plant[0]), **maps)


def errors(estimate, plant):
    """Relative Frobenius errors of M, D, K."""
    found = (estimate.M, estimate.D, estimate.K)
    return np.array([np.linalg.norm(X - Y) / np.linalg.norm(Y) for X, Y in zip(found, plant)])


def covered(estimates, plant, pack):
    """(runs, ntheta) bool: the true value is within 1.96 standard errors."""
    truth = pack(*plant)
    return np.array(
        [np.abs(pack(e.M, e.D, e.K) - truth) <= 1.96 * np.sqrt(np.diag(e.covariance)) for e in estimates]
    )


def pole_error(estimate, plant):
    """Relative error of the poles after optimal assignment."""
    truth = poles(*plant)
    distance = np.abs(estimate.poles[:, None] - truth[None, :]) ** 2
    return np.sqrt(distance[linear_sum_assignment(distance)].sum()) / np.linalg.norm(truth)
