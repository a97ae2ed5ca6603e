"""plant, record, noise variances -> Cramer-Rao bound of that very record on M, D, K, A and the poles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid_bench.mechanics.modal import sensitivity
from sysid_bench.mechanics.second_order import (
    DEFECTIVE_CONDITION,
    Complex,
    companion,
    ntheta,
    pairs,
    pole_order,
    unpack,
)
from sysid_bench.nouns import Array, InputError, Model, Plant, Record

# Smallest eigenvalue of the information, scaled to a unit diagonal, that rounding leaves meaningful.
IDENTIFIABLE = 1e-13


@dataclass(frozen=True, eq=False)
class Bound:
    """Least rms errors of any unbiased estimator, relative: sqrt(E ||X^ - X||_F^2) / ||X||_F, off-diagonals twice.

    M, D, K, A (companion), pole: relative; absolute where the truth is zero (an undamped plant's
    D); pole is NaN for a defective plant, whose double poles have no first derivative
    covariance (ntheta, ntheta) of theta, zero rows for entries that are not free; poles (2n,) rms of each, rad/s
    """

    M: float
    D: float
    K: float
    A: float
    pole: float
    covariance: Array
    poles: Array


def crlb(
    plant: Plant | Model,
    record: Record,
    variance: Array,
    initial_state: str = "free",
    x0: Array | None = None,
    free: NDArray[np.bool_] | None = None,
) -> Bound:
    """The bound at the true values for white noise of known variance (ny,) per channel and symmetric matrices.

    initial_state: "free" (estimated along) or "known"; x0 (2n,): its true value, taken from the record where None
    (zero unless the record says otherwise); free (ntheta,): entries of theta that are unknown, all where None.
    Raises InputError for a record without a hold, LinAlgError where theta is not identifiable from the record.
    """
    information = information_matrix(plant, record, variance, x0)
    count = ntheta(plant.n)
    unknown = np.ones(count, dtype=bool) if free is None else np.asarray(free, dtype=bool)
    nuisance = np.full(2 * plant.n, initial_state == "free")
    live = np.concatenate([unknown, nuisance])
    inverse = inverse_information(information[np.ix_(live, live)])
    covariance = np.zeros((count, count))
    covariance[np.ix_(unknown, unknown)] = inverse[: unknown.sum(), : unknown.sum()]
    return bound_of(plant, covariance)


def information_matrix(
    plant: Plant | Model, record: Record, variance: Array, x0: Array | None = None
) -> Array:
    """Fisher information (np, np) of p = (theta, x0), per channel variance (ny,); x0 as in crlb. Raises InputError without a hold."""
    good = None if record.quality is None else record.quality == 0
    weights = 1 / np.asarray(variance, dtype=float)
    if record.hold is None:
        raise InputError("a bound needs to know how the input runs between samples; this record has no hold.")
    parts = (*plant.matrices, plant.input_map, plant.output_map, plant.output)
    found = sensitivity(*parts, record.u, record.h, record.hold, x0, record.period)
    information, shadow = found.normal(record.y - found.y if x0 is None else None, weights, good)
    if x0 is not None:
        return information
    x0 = significant_start(information, shadow, 2 * plant.n)
    return information if x0 is None else information_matrix(plant, record, variance, x0)


def significant_start(information: Array, shadow: Array, nx: int) -> Array | None:
    """The initial state (nx,) that fits best, None where it is zero within six sigma of its chi-square."""
    H, g = information[-nx:, -nx:], shadow[-nx:]
    x0 = np.linalg.lstsq(H, g, rcond=1e-12)[0]
    return x0 if x0 @ g > nx + 6 * np.sqrt(2 * nx) else None


def inverse_information(information: Array) -> Array:
    """Inverse of an information (ntheta, ntheta), scaled first. Raises LinAlgError where a direction is not seen by the record."""
    scale = np.sqrt(np.diag(information))
    if not np.all(np.isfinite(scale)) or np.any(scale == 0):
        raise np.linalg.LinAlgError("some parameter has no influence on the output")
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    if values[0] < IDENTIFIABLE * values[-1]:
        raise np.linalg.LinAlgError(
            f"the record does not determine all parameters: eigenvalues of the information reach {values[0]:.1e}"
        )
    inverse = (vectors / values) @ vectors.T
    return inverse / np.outer(scale, scale)


def bound_of(plant: Plant | Model, covariance: Array) -> Bound:
    """A covariance of theta (ntheta, ntheta) -> relative rms errors of the matrices and poles, by delta method."""
    M, D, K = plant.matrices
    per_matrix, twice = ntheta(plant.n) // 3, np.array([1.0 if i == j else 2.0 for i, j in pairs(plant.n)])
    parts = np.diag(covariance).reshape(3, per_matrix) @ twice
    of_M, of_D, of_K = (_relative(square, X) for square, X in zip(parts, (M, D, K)))
    slopes, lam, pole_slopes = derivatives(M, D, K)
    flat = slopes.reshape(len(slopes), -1)
    of_A = np.einsum("pa,pq,qa->", flat, covariance, flat, optimize=True)
    of_poles = np.einsum("pk,pq,qk->k", pole_slopes, covariance, pole_slopes.conj(), optimize=True).real
    A = _relative(of_A, companion(M, D, K))
    return Bound(of_M, of_D, of_K, A, _relative(of_poles.sum(), lam), covariance, np.sqrt(of_poles))


def derivatives(M: Array, D: Array, K: Array) -> tuple[Array, Complex, Complex]:
    """dA/dtheta (ntheta, 2n, 2n), poles (2n,) sorted by magnitude, dpoles/dtheta (ntheta, 2n).

    Where poles coincide in a defective matrix they have no slopes: NaN.
    """
    n, A = len(M), companion(M, D, K)
    inverse, slopes = np.linalg.inv(M), np.zeros((ntheta(n), 2 * n, 2 * n))
    for p, unit in enumerate(np.eye(ntheta(n))):
        dM, dD, dK = unpack(unit, n)
        slopes[p, n:] = -inverse @ (np.hstack([dK, dD]) + dM @ A[n:])
    lam, V = np.linalg.eig(A)
    order = pole_order(lam)
    lam, V = lam[order].astype(complex), V[:, order].astype(complex)
    if np.linalg.cond(V / np.linalg.norm(V, axis=1, keepdims=True)) > DEFECTIVE_CONDITION:
        return slopes, lam, np.full((len(slopes), 2 * n), np.nan, dtype=complex)
    return slopes, lam, np.einsum("ka,pab,bk->pk", np.linalg.inv(V), slopes, V, optimize=True)


def _relative(square: float, truth: Array) -> float:
    scale = np.linalg.norm(truth)
    return float(np.sqrt(square) / (scale if scale > 0 else 1.0))
