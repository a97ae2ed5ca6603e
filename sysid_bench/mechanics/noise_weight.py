"""residuals in the band -> the weight of the likelihood: inverse noise covariance, per channel, full or per bin.

A weight is an array (1, ny): one variance per channel; (1, ny, ny): a full covariance; (F, ny): a noise
spectrum per channel. All are inverses, so that the information is the real part of J^H W J.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from sysid_bench.mechanics.in_band import squared
from sysid_bench.nouns import Array, Complex

TINY = 1e-300
BEST_RATIO = 1e-8  # noise to signal, 80 dB: a better sensor counts as that good, or as the worst one


def weigh(W: Array, X: Complex) -> Complex:
    """W X for X (F, ny) or (F, ny, k)."""
    if W.ndim == 3:
        return np.matmul(W, X) if X.ndim == 3 else X @ W[0].T
    return X * (W[:, :, None] if X.ndim == 3 else W)


def root(W: Array) -> Array:
    """B, of the shape of W (1, ny), (F, ny) or (1, ny, ny), with W = B^T B."""
    return np.linalg.cholesky(W).swapaxes(1, 2) if W.ndim == 3 else np.sqrt(W)


def modal_gram(d: Complex, c: Complex, W: Array) -> Complex:
    """(nt, nt) sum over f of T^H W T for the separable columns T[f, i, k] = c[i, k] d[f, k]."""
    if W.ndim == 3:
        return (np.conj(d).T @ d) * (np.conj(c).T @ W[0] @ c)
    if len(W) == 1:
        return (np.conj(d).T @ d) * ((np.conj(c).T * W[0]) @ c)
    parts = ((np.conj(d).T * W[:, i]) @ d * np.outer(np.conj(c[i]), c[i]) for i in range(len(c)))
    return sum(parts, np.zeros(()))


def variances(R: Complex, power: Array, count: float) -> tuple[Array, Array]:
    """(ny,) noise variances from residuals with `count` real observations per channel, and what to divide by.

    They differ where a sensor is cleaner than BEST_RATIO: without a floor, the first channel to be fitted
    exactly would drown the others.
    """
    v = squared(R).sum(axis=0) / count
    worst = (v / power).max()
    return v, np.maximum(np.maximum(v, min(worst, max(BEST_RATIO, 1e-6 * worst)) * power), TINY)


def covariance(R: Complex, count: float) -> Array:
    """(ny, ny) real noise covariance from residuals."""
    S = np.real(np.conj(R).T @ R) / count
    return S + 1e-14 * np.trace(S) / len(S) * np.eye(len(S)) + TINY * np.eye(len(S))


def estimated(R: Complex, power: Array, count: float, kind: str) -> tuple[Array, float]:
    """Weight and the concentrated negative log-likelihood (up to a constant), kind diagonal or full.

    power (ny,): of the output per channel.
    """
    if kind == "full":
        S = covariance(R, count)
        return np.linalg.inv(S)[None], 0.5 * count * float(np.linalg.slogdet(S)[1])
    v, floored = variances(R, power, count)
    return 1 / floored[None, :], 0.5 * count * float((np.log(floored) + v / floored).sum())


def given(R: Complex, W: Array) -> float:
    """Negative log-likelihood of residuals under a known weight."""
    return 0.5 * float(np.real(np.conj(R) * weigh(W, R)).sum())


def noise_spectrum(R: Complex, weight: Array, width: int | None = None) -> Array:
    """(F, ny) inverse noise spectrum: residual power smoothed over `width` bins (about F / 40, 15 at least).

    weight (F,): of the bins, which tells those that hold one real number.
    """
    width = width or int(np.clip(len(R) // 40, 15, 61))
    single = (weight < 0.9 * weight.max())[:, None]
    power = np.where(single, 1.0, 0.5) * squared(R)
    smooth = uniform_filter1d(power, min(width, len(R)), axis=0, mode="reflect")
    return 1 / np.maximum(smooth, 1e-6 * smooth.max(axis=0) + TINY)
