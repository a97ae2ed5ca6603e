"""M, D, K with their covariance -> standard errors of poles, natural frequencies and damping ratios."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid_bench.nouns import Array

Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class ModalUncertainty:
    """One row per pole with non-negative imaginary part, by rising frequency; rad/s."""

    poles: Complex
    omega_n: Array
    omega_n_std: Array
    zeta: Array
    zeta_std: Array


def pole_slopes(M: Array, D: Array, K: Array) -> tuple[Complex, Complex]:
    """poles (2n,) and their derivatives (2n, ntheta): -phi'(s^2 dM + s dD + dK) phi / phi'(2 s M + D) phi."""
    n = len(M)
    gain = np.linalg.inv(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-gain @ K, -gain @ D]])
    poles, vectors = np.linalg.eig(A)
    phi = vectors[:n].astype(complex)
    below = np.einsum("ik,ijk,jk->k", phi, 2 * poles * M[:, :, None] + D[:, :, None], phi)
    i, j = np.triu_indices(n)
    products = phi[i] * phi[j] * np.where(i == j, 1.0, 2.0)[:, None]
    slopes = np.concatenate([products * poles**b for b in (2, 1, 0)]) / -below
    return poles.astype(complex), slopes.T


def modal_uncertainty(M: Array, D: Array, K: Array, covariance: Array) -> ModalUncertainty:
    """First-order standard errors; covariance (ntheta, ntheta) as in Estimate."""
    poles, slopes = pole_slopes(M, D, K)
    keep = np.flatnonzero(poles.imag >= 0)
    keep = keep[np.argsort(np.abs(poles[keep]))]
    poles, slopes = poles[keep], slopes[keep]
    size = np.maximum(np.abs(poles), np.finfo(float).tiny)
    omega_slope = (np.conj(poles)[:, None] * slopes).real / size[:, None]
    zeta = -poles.real / size
    zeta_slope = -slopes.real / size[:, None] - (zeta / size)[:, None] * omega_slope
    omega_std, zeta_std = (
        np.sqrt(np.maximum(np.einsum("kp,pq,kq->k", J, covariance, J), 0.0))
        for J in (omega_slope, zeta_slope)
    )
    return ModalUncertainty(poles, np.abs(poles), omega_std, zeta, zeta_std)
