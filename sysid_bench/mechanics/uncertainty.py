"""M, D, K with their covariance -> covariance of poles, natural frequencies and damping ratios, by first order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.second_order import companion, pole_order
from sysid_bench.nouns import Array, Complex, Estimate

REPEATED = 1e-6  # of a pole's size: closer poles have no first derivative of their own
SAME_POLES = 1e-6


@dataclass(frozen=True, eq=False)
class ModalUncertainty:
    """One row per complex pair and per real pole, as frequencies_and_damping orders them.

    poles (k,) rad/s, positive imaginary part; omega_n (k,) rad/s; zeta (k,)
    covariance (2k, 2k) of (omega_n, zeta); pole_covariance (2k, 2k) of (real parts, imaginary parts)
    Not a number where poles coincide, infinite where the record does not tell.
    """

    poles: Complex
    omega_n: Array
    zeta: Array
    covariance: Array
    pole_covariance: Array

    @property
    def omega_n_std(self) -> Array:
        return _deviations(self.covariance)[: len(self.poles)]

    @property
    def zeta_std(self) -> Array:
        return _deviations(self.covariance)[len(self.poles) :]

    @property
    def pole_std(self) -> Complex:
        """Standard error of the real part + j that of the imaginary part."""
        found = np.empty(len(self.poles), dtype=complex)  # j times infinity is not a number
        found.real, found.imag = np.split(_deviations(self.pole_covariance), 2)
        return found


def pole_slopes(M: Array, D: Array, K: Array) -> tuple[Complex, Complex]:
    """poles (2n,) by pole_order and their derivatives (2n, ntheta): -phi'(s^2 dM + s dD + dK) phi / phi'(2 s M + D) phi.

    Not a number where poles coincide: those of symmetric matrices part in directions that no gradient gives.
    """
    n = len(M)
    poles, vectors = np.linalg.eig(companion(M, D, K))
    order = pole_order(poles)
    poles, phi = poles[order].astype(complex), vectors[:n, order].astype(complex)
    i, j = np.triu_indices(n)
    products = phi[i] * phi[j] * np.where(i == j, 1.0, 2.0)[:, None]
    with np.errstate(all="ignore"):
        below = np.einsum("ik,ijk,jk->k", phi, 2 * poles * M[:, :, None] + D[:, :, None], phi)
        slopes = np.concatenate([products * poles**b for b in (2, 1, 0)]) / -below
    distance = np.abs(poles[:, None] - poles) + np.diag(np.full(2 * n, np.inf))
    slopes[:, distance.min(axis=1) <= REPEATED * np.abs(poles).max()] = np.nan
    return poles, slopes.T


def modal_uncertainty(M: Array, D: Array, K: Array, covariance: Array) -> ModalUncertainty:
    """First order in covariance (ntheta, ntheta), as in Estimate."""
    poles, slopes = pole_slopes(M, D, K)
    poles, slopes = poles[poles.imag >= 0], slopes[poles.imag >= 0]
    size = np.abs(poles)
    scale = np.where(size > 0, size, np.nan)  # a rigid body has no damping ratio
    of_omega = np.real(np.conj(poles)[:, None] * slopes) / scale[:, None]
    zeta = np.divide(-poles.real, size, out=np.zeros_like(size), where=size > 0)
    of_zeta = -(slopes.real + zeta[:, None] * of_omega) / scale[:, None]
    of_zeta[poles.imag == 0] = 0.0  # one or minus one, whatever the entries
    both, parts = np.vstack([of_omega, of_zeta]), np.vstack([slopes.real, slopes.imag])
    return ModalUncertainty(poles, size, zeta, _through(both, covariance), _through(parts, covariance))


def uncertainty_of(estimate: Estimate) -> ModalUncertainty | None:
    """Of an estimate whose poles are those of its M, D, K; None where it has no covariance, or other poles."""
    parts = estimate.M, estimate.D, estimate.K, estimate.covariance
    if any(part is None for part in parts) or estimate.poles is None:
        return None
    found = modal_uncertainty(*parts)  # type: ignore[arg-type]
    given = np.asarray(estimate.poles)
    given = given[pole_order(given)]
    given = given[given.imag >= 0]
    same = len(given) == len(found.poles) and np.allclose(given, found.poles, SAME_POLES, 0)
    return found if same else None


def _through(slopes: Array, covariance: Array) -> Array:
    """slopes covariance slopes'; infinite where an infinite variance takes part."""
    blind = np.isinf(np.diag(covariance))
    finite = np.where(np.isfinite(covariance), covariance, 0.0)
    found = slopes @ finite @ slopes.T
    touched = np.abs(slopes[:, blind]).max(axis=1, initial=0.0) > 0
    found[touched, touched] = np.inf
    return found


def _deviations(covariance: Array) -> Array:
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))
