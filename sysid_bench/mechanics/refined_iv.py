"""spectra, a start -> M, D, K by refined instrumental variables: linear steps only, no cost to descend.

Each step filters both sides of M q'' + D q' + K q = L u by the inverse of the last estimate and solves the
linear equations with the model's own response as instruments (the matrix form of SRIVC: Young & Jakeman 1980;
Gonzalez, Rojas, Welsh & Rojas 2023). Noise on y does not bias it, since instruments come from u alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics import normal_equations as ne
from sysid_bench.mechanics.hold_spectra import hold_spectrum
from sysid_bench.mechanics.in_band import Spectra
from sysid_bench.mechanics.response import Maps
from sysid_bench.mechanics.second_order import unpack
from sysid_bench.nouns import Array, Complex, Diverged

FLOOR = (
    0.02  # of the largest eigenvalue: what the filter's matrices are kept above, or the first step overflows
)


def definite(X: Array, floor: float = FLOOR) -> Array:
    """The symmetric (n, n) matrix with eigenvalues not below `floor` of the largest magnitude."""
    values, vectors = np.linalg.eigh(X)
    return (vectors * np.maximum(values, floor * np.abs(values).max())) @ vectors.T


@dataclass(frozen=True, eq=False)
class _Filtered:
    """One pass: G (F, n, n) the inverse of the last estimate, q (F, n) its response, weight, boundary columns."""

    s: Complex
    G: Complex
    Q: Complex
    drive: Complex
    ends: Complex


def _filtered(data: Spectra, maps: Maps, F: int, theta: Array) -> _Filtered:
    first = 1 if maps.power else 0
    s = 1j * data.omega[first:F]
    M, D, K = (definite(X) for X in unpack(theta, maps.n))
    G = np.linalg.inv(s[:, None, None] ** 2 * M + s[:, None, None] * D + K)
    Q = (data.Y[first:F] @ np.linalg.pinv(maps.C).T) / (s**maps.power)[:, None]
    drive = (data.U[first:F] * hold_spectrum(s.imag, data.h, data.hold)[:, None]) @ maps.L.T
    columns = np.stack([s ** (2 - p) for p in range(3 + maps.power)], axis=1) * data.weight[first:F, None]
    ends = (G[:, :, :, None] * columns[:, None, None, :]).reshape(len(s), maps.n, -1)
    return _Filtered(s, G, Q, drive, ends / np.sqrt((np.abs(ends) ** 2).sum(axis=(0, 1))))


def _model_motion(part: _Filtered, W: Array) -> Complex:
    """Response of the last estimate to the input, with the boundary terms that fit the output best."""
    forced = (part.G @ part.drive[:, :, None])[:, :, 0]
    T = part.ends * np.sqrt(W)[:, None]
    r = (part.Q - forced) * np.sqrt(W)
    A = np.real(np.conj(T).reshape(-1, T.shape[2]).T @ T.reshape(-1, T.shape[2]))
    b = np.real(np.conj(T).reshape(-1, T.shape[2]).T @ r.ravel())
    return forced + part.ends @ np.linalg.lstsq(A, b, rcond=1e-12)[0]


def _step(data: Spectra, maps: Maps, F: int, theta: Array) -> tuple[Array, Array]:
    """The next estimate and the weights that it was made with."""
    part = _filtered(data, maps, F, theta)
    W = 1 / (np.abs(part.Q - _model_motion(part, np.ones(maps.n))) ** 2).mean(axis=0)
    q = _model_motion(part, W)
    GW = np.conj(np.swapaxes(part.G, 1, 2)) * W
    Omega = np.conj(q)[:, :, None] * part.Q[:, None, :]
    H = ne.information(GW @ part.G, Omega, part.s.imag, hermitian=False)
    g = -ne.gradient(part.s, (GW @ (part.G @ part.drive[:, :, None]))[:, :, 0], q)
    back = GW @ part.ends
    instruments, regressors = (ne.cross(part.s, x, back).real for x in (q, part.Q))
    T = (part.ends * np.sqrt(W)[:, None]).reshape(-1, part.ends.shape[2])
    forced = ((part.G @ part.drive[:, :, None])[:, :, 0] * np.sqrt(W)).ravel()
    slope = (np.conj(T).T @ forced).real
    half = np.linalg.lstsq((np.conj(T).T @ T).real, np.column_stack([regressors.T, -slope]), rcond=1e-12)[0]
    H, g = H - instruments @ half[:, :-1], g - instruments @ half[:, -1]
    d = np.sqrt(np.maximum(np.abs(np.diag(H)), 1e-300))
    return np.linalg.solve(H / np.outer(d, d), g / d) / d, W


def refine(
    data: Spectra, maps: Maps, F: int, theta: Array, steps: int, tolerance: float = 1e-6
) -> tuple[Array, int, bool]:
    """theta after at most `steps` steps, their number, and whether it came to rest (relative change).

    Needs an invertible output map. Raises Diverged where the equations cannot be solved.
    """
    for step in range(1, steps + 1):
        try:
            new, _ = _step(data, maps, F, theta)
        except np.linalg.LinAlgError as problem:
            raise Diverged(
                f"refined instrumental variables: step {step} has no solution ({problem})."
            ) from None
        change = max(
            np.linalg.norm(a - b) / np.linalg.norm(a)
            for a, b in zip(new.reshape(3, -1), theta.reshape(3, -1))
        )
        theta = new
        if not np.all(np.isfinite(theta)):
            raise Diverged(f"refined instrumental variables: step {step} is not finite.")
        if change < tolerance:
            return theta, step, True
    return theta, steps, False
