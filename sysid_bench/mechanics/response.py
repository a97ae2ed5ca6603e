"""M, D, K, maps -> modes; modes, spectra -> the exact sampled response and its sensitivities in the band.

The response to the held input is exact (closed form per mode). Sensitivities use that sampling folds the
axis: a sampled response is the sum over images s_m = j(omega + 2 pi m / h) of G(s_m) times the hold's
spectrum there, so dY/dtheta = - sum_m s_m^b C G(s_m) E q(s_m), without a division by pole differences.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, rfft

from sysid_bench.mechanics.hold_spectra import discrete_modes, hold_spectrum
from sysid_bench.mechanics.in_band import Spectra
from sysid_bench.nouns import Array, Complex, Diverged

POWER = {"displacement": 0, "velocity": 1, "acceleration": 2}


@dataclass(frozen=True, eq=False)
class Maps:
    """What is driven and what is seen: L (n, nu), C (ny, n), power of s in front of C."""

    L: Array
    C: Array
    power: int = 0

    @property
    def n(self) -> int:
        return len(self.L)


@dataclass(frozen=True, eq=False)
class Modes:
    """G(s) = (M s^2 + D s + K)^-1 = sum_k shape_k left_k / (s - pole_k).

    poles (2n,), shape (n, 2n), left (2n, n), inverse (2n, 2n): state x = [q; q'] -> modal coordinates;
    gain (n, n): the inverse of M.
    """

    poles: Complex
    shape: Complex
    left: Complex
    inverse: Complex
    gain: Array

    @property
    def n(self) -> int:
        return len(self.shape)


def modes_of(M: Array, D: Array, K: Array) -> Modes:
    """Eigenvectors of the first-order form. Raises Diverged where M is singular or a matrix is not finite."""
    n = len(M)
    try:
        gain = np.linalg.inv(M)
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-gain @ K, -gain @ D]])
        poles, vectors = np.linalg.eig(A)
        inverse = np.linalg.inv(vectors)
    except (np.linalg.LinAlgError, ValueError) as problem:
        raise Diverged(f"the mass matrix left what can be simulated ({problem}).") from None
    poles = poles.astype(complex)
    return Modes(poles, vectors[:n].astype(complex), inverse[:, n:] @ gain, inverse.astype(complex), gain)


def output_modes(modes: Modes, maps: Maps) -> Complex:
    """(ny, 2n): what each modal coordinate shows at the sensors."""
    return (maps.C @ modes.shape) * modes.poles**maps.power


def forced(modes: Modes, maps: Maps, data: Spectra, F: int) -> Complex:
    """Exact spectrum (F, ny) of the sampled response, up to the transient of `transient`."""
    inputs = (modes.left @ maps.L).T
    if data.drive is None:
        return _steady(modes, maps, data, inputs)[:F]
    discrete, weights = discrete_modes(modes.poles, data.h, data.hold)
    z = np.exp(1j * data.omega[:F] * data.h)
    modal = sum((data.drive[j, :F] @ inputs) * weights[j] for j in range(len(data.drive)))
    Y = (modal / (z[:, None] - discrete)) @ output_modes(modes, maps).T
    if maps.power == 2:
        Y = Y + data.U[:F] @ (maps.C @ modes.gain @ maps.L).T
    return Y


def _steady(modes: Modes, maps: Maps, data: Spectra, inputs: Complex) -> Complex:
    """Steady state to the Fourier series of one period, cut to the record's length."""
    P, N = data.period, data.N
    s = 1j * data.omega if P == N else 2j * np.pi * np.arange(P // 2 + 1) / (P * data.h)
    U = rfft(data.u[:P], axis=0) if P != N else data.U / data.weight[:, None]
    Y = (((U @ inputs) / (s[:, None] - modes.poles)) @ (maps.C @ modes.shape).T) * s[:, None] ** maps.power
    if P == N:
        return Y * data.weight[:, None]
    period = irfft(Y, P, axis=0)
    return rfft(np.tile(period, (-(-N // P), 1))[:N], axis=0) * data.weight[:, None]


def transient(modes: Modes, data: Spectra, F: int) -> Complex:
    """(F, 2n) spectra of the modal coordinates' free motion from one; wraps round the end of the record."""
    z = np.exp(1j * data.omega[:F] * data.h)[:, None]
    return z / (z - np.exp(modes.poles * data.h)) * data.weight[:F, None]


@dataclass(frozen=True, eq=False)
class Image:
    """One fold of the frequency axis: s (F,), s^a C G factors over modes (F, 2n), q (F, n) the motion there."""

    s: Complex
    pole_gain: Complex
    q: Complex


def image(modes: Modes, maps: Maps, data: Spectra, F: int, m: int, start: Complex) -> Image:
    """Image m of the band's first F bins; start (2n,): modal coordinates of the free motion."""
    omega = data.omega[:F] + 2 * np.pi * m / data.h
    s = 1j * omega
    resolvent = 1 / (s[:, None] - modes.poles)
    drive = data.U[:F] * hold_spectrum(omega, data.h, data.hold)[:, None]
    modal = drive @ (modes.left @ maps.L).T + data.weight[:F, None] * (start / data.h)
    return Image(s, resolvent * (s**maps.power)[:, None], (modal * resolvent) @ modes.shape.T)


def transfer(modes: Modes, maps: Maps, fold: Image) -> Complex:
    """(F, ny, n): s^a C G(s) at an image."""
    pairs = (maps.C @ modes.shape)[:, None, :] * modes.left.T[None, :, :]
    ny, n, nm = pairs.shape
    return (fold.pole_gain @ pairs.reshape(ny * n, nm).T).reshape(-1, ny, n)
