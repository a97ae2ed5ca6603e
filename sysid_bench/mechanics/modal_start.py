"""spectra -> M, D, K by way of modes: a start that needs neither a sensor nor a force on every mass.

Poles from a subspace step on decimated samples; residues R_k = (C phi_k) (L' phi_k)' by linear least squares under
the record's own hold; shapes from sensors and forces together, scaled where both see the same motion.
"""

from __future__ import annotations

import numpy as np

from sysid_bench.mechanics.conversion import continuous_poles
from sysid_bench.mechanics.decimation import decimate, decimation_factor
from sysid_bench.mechanics.hold_spectra import discrete_modes, hold_spectrum
from sysid_bench.mechanics.in_band import MARGIN, Spectra
from sysid_bench.mechanics.refined_iv import definite
from sysid_bench.mechanics.response import Maps
from sysid_bench.mechanics.second_order import pack
from sysid_bench.mechanics.subspace import HalfModes, check_sizes, default_horizon, identify_modes
from sysid_bench.nouns import Array, Complex, Diverged, NotApplicable


def modal_start(data: Spectra, maps: Maps, F: int, per_period: float = 8.0) -> Array:
    """theta (ntheta,) from modes. Raises NotApplicable where sensors and forces together do not see every degree of
    freedom, Diverged where the modes found do not make a mechanical system."""
    ny, nu = len(maps.C), maps.L.shape[1]
    if ny + nu <= maps.n or np.linalg.matrix_rank(np.vstack([maps.C, maps.L.T])) < maps.n:
        raise NotApplicable("sensors and forces together do not reach every degree of freedom.")
    poles, weight = subspace_poles(data, maps, F, per_period)
    R = residues(data, maps, F, poles, weight)
    shapes = np.stack([_shape(Rk, maps, pole) for Rk, pole in zip(R, poles)], axis=1)
    pair = weight == 2
    poles, shapes = (
        np.concatenate([poles, np.conj(poles[pair])]),
        np.hstack([shapes, np.conj(shapes[:, pair])]),
    )
    return _matrices(poles, shapes)


def subspace_poles(data: Spectra, maps: Maps, F: int, per_period: float = 8.0) -> tuple[Complex, Array]:
    """Continuous poles, one of each pair, and their weights (2 for a pair)."""
    top = data.omega[F - 1] / MARGIN
    factor = decimation_factor(data.h, top, data.N, per_period)
    u, y = decimate(data.u, factor), decimate(data.y, factor)
    nx = 2 * maps.n
    i = default_horizon(len(u), u.shape[1], y.shape[1], nx)
    check_sizes(len(u), u.shape[1], y.shape[1], i, nx)
    z = np.hstack([u / np.maximum(u.std(axis=0), 1e-300), y / np.maximum(y.std(axis=0), 1e-300)])
    half: HalfModes = identify_modes(z, u.shape[1], i, nx, "moesp", nx)[0]
    return continuous_poles(half.p, data.h * factor), half.weight


def residues(data: Spectra, maps: Maps, F: int, poles: Complex, weight: Array) -> Complex:
    """(k, ny, nu) by least squares in the band, with the free motion of every mode."""
    nu, pair = data.U.shape[1], weight == 2
    both = np.concatenate([poles, np.conj(poles)])
    X = _modal_inputs(data, both, F)
    X, Xc = X[:, : len(poles)], X[:, len(poles) :]
    real, imag = np.where(pair[:, None], X + Xc, X), 1j * (X - Xc)[:, pair]
    columns = np.concatenate([real.reshape(F, -1), imag.reshape(F, -1)], axis=1)
    if maps.power == 2:
        columns = np.concatenate([columns, data.U[:F]], axis=1)
    stacked, target = (np.concatenate([x.real, x.imag]) for x in (columns, data.Y[:F]))
    scale = np.maximum(np.linalg.norm(stacked, axis=0), 1e-300)
    found = np.linalg.lstsq(stacked / scale, target, rcond=1e-12)[0] / scale[:, None]
    K, count = len(poles), int(pair.sum())
    R = found[: K * (nu + 1)].reshape(K, nu + 1, -1).astype(complex)
    R[pair] += 1j * found[K * (nu + 1) : (K + count) * (nu + 1)].reshape(count, nu + 1, -1)
    return np.swapaxes(R[:, :nu], 1, 2)


def _modal_inputs(data: Spectra, poles: Complex, F: int) -> Complex:
    """(F, modes, nu + 1): each mode's response to each input, and its free motion."""
    z = data.z[:F]
    discrete = np.exp(poles * data.h)
    free = (z / (z - discrete) * data.weight[:F, None])[:, :, None]
    if data.drive is None:
        held = data.U[:F] * hold_spectrum(data.omega[:F], data.h, data.hold)[:, None]
        forced = held[:, None, :] / (1j * data.omega[:F, None, None] - poles[:, None])
    else:
        _, weights = discrete_modes(poles, data.h, data.hold)
        forced = np.einsum("fju,jk->fku", data.drive[:F], weights) / (z - discrete)[:, :, None]
    return np.concatenate([forced, free], axis=2)


def _shape(R: Complex, maps: Maps, pole: complex) -> Complex:
    """phi with R = pole^a (C phi)(L' phi)': from the leading singular pair, in the sensors' and forces' span."""
    U, s, Vh = np.linalg.svd(R / pole**maps.power)
    u, v = U[:, 0], Vh[0]
    ny, n = maps.C.shape
    nu = maps.L.shape[1]
    left = np.hstack([maps.C, -u[:, None], np.zeros((ny, 1))])
    right = np.hstack([maps.L.T, np.zeros((nu, 1)), -v[:, None]])
    null = np.conj(np.linalg.svd(np.vstack([left, right]))[2][-1])
    phi, alpha, beta = null[:n], null[n], null[n + 1]
    if abs(alpha * beta) < 1e-12:
        raise Diverged("no sensor shares a motion with a force: the scale of a mode cannot be told.")
    return phi * np.sqrt(s[0] / (alpha * beta))


def _matrices(poles: Complex, shapes: Complex) -> Array:
    """M = (Phi Lam Phi')^-1, K = -(Phi Lam^-1 Phi')^-1, D = -M Phi Lam^2 Phi' M."""
    try:
        M = np.linalg.inv(np.real((shapes * poles) @ shapes.T))
        K = -np.linalg.inv(((shapes / poles) @ shapes.T).real)
    except np.linalg.LinAlgError:
        raise Diverged("the modes found do not span the degrees of freedom.") from None
    D = -M @ np.real((shapes * poles**2) @ shapes.T) @ M
    if not all(np.all(np.isfinite(X)) for X in (M, D, K)):
        raise Diverged("the modes found do not make a mechanical system.")
    return pack(*definite(np.stack([(X + X.T) / 2 for X in (M, D, K)])))
