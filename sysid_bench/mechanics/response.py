"""M, D, K, maps -> modes; modes, spectra -> the exact sampled response and its sensitivities in the band.

The response to the held input is exact (closed form per mode). Sensitivities use that sampling folds the
axis: a sampled response is the sum over images s_m = j(omega + 2 pi m / h) of G(s_m) times the hold's
spectrum there, so dY/dtheta = - sum_m s_m^b C G(s_m) E q(s_m), without a division by pole differences.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, rfft

from sysid_bench.mechanics.hold_spectra import discrete_modes
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
    A = np.zeros((2 * n, 2 * n))
    A[np.arange(n), n + np.arange(n)] = 1.0
    try:
        gain = np.linalg.inv(M)
        A[n:, :n], A[n:, n:] = -gain @ K, -gain @ D
        poles, vectors = np.linalg.eig(A)
        inverse = np.linalg.inv(vectors)
    except (np.linalg.LinAlgError, ValueError) as problem:
        raise Diverged(f"the mass matrix left what can be simulated ({problem}).") from None
    poles = poles.astype(complex)
    return Modes(poles, vectors[:n].astype(complex), inverse[:, n:] @ gain, inverse.astype(complex), gain)


def output_modes(modes: Modes, maps: Maps) -> Complex:
    """(ny, 2n): what each modal coordinate shows at the sensors."""
    return (maps.C @ modes.shape) * modes.poles**maps.power


@dataclass(frozen=True, eq=False)
class Sampled:
    """The exact sampled spectra: of the forced response (F, ny), up to the free motion; of the free motion (F, 2n) of each
    modal coordinate from one, which wraps round the end of the record."""

    forced: Complex
    free: Complex


def sampled(modes: Modes, maps: Maps, data: Spectra, F: int) -> Sampled:
    """In the first F bins."""
    inputs = (modes.left @ maps.L).T
    z = data.z[:F]
    if data.drive is None:
        free = z * data.weight[:F, None] / (z - np.exp(modes.poles * data.h))
        return Sampled(_steady(modes, maps, data, inputs)[:F], free)
    discrete, weights = discrete_modes(modes.poles, data.h, data.hold)
    resolvent = 1 / (z - discrete)
    modal = data.drive[:F].reshape(F, -1) @ (weights[:, None, :] * inputs).reshape(-1, len(discrete))
    Y = (modal * resolvent) @ output_modes(modes, maps).T
    if maps.power == 2:
        Y = Y + data.U[:F] @ (maps.C @ modes.gain @ maps.L).T
    return Sampled(Y, resolvent * (z * data.weight[:F, None]))


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


@dataclass(frozen=True, eq=False)
class Image:
    """One fold of the frequency axis: s (F,), s^a C G factors over modes (F, 2n), q (F, n) the motion there."""

    s: Complex
    pole_gain: Complex
    q: Complex


def image(modes: Modes, maps: Maps, s: Complex, held: Complex, weight: Array) -> Image:
    """At s (..., F): held (..., F, nu) is the held input's spectrum there; weight (F, 1) times a state (2n,) the free motion's."""
    resolvent = 1 / (s[..., None] - modes.poles)
    modal = held @ (modes.left @ maps.L).T + weight
    gain = resolvent if maps.power == 0 else resolvent * (s**maps.power)[..., None]
    return Image(s, gain, (modal * resolvent) @ modes.shape.T)


def transfer(modes: Modes, seen: Complex, pole_gain: Complex) -> Complex:
    """(F, ny, n): s^a C G(s); seen (ny, 2n): C times the modes' shapes, pole_gain (F, 2n): s^a / (s - poles)."""
    pairs = seen[:, None, :] * modes.left.T[None, :, :]
    ny, n, nm = pairs.shape
    return (pole_gain @ pairs.reshape(ny * n, nm).T).reshape(-1, ny, n)
