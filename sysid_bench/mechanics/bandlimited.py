"""Fourier lines of an input -> the steady-state response at the samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sysid_bench.nouns import Array, InputError

Complex = NDArray[np.complex128]
RESONANT = 1e-9  # |i omega - pole| below this times the fastest rate in sight: no steady state to speak of


def lines_of(u: Array, h: float, period: int | None) -> tuple[Array, Complex]:
    """Fourier series (omega (nl,) rad/s, amplitude (nl, nu)) of one period of the samples u (N, nu).

    u(t) = Re sum_l amplitude_l exp(i omega_l t); a line at the Nyquist frequency is a pure cosine.
    """
    P = len(u) if period is None else period
    if not 0 < P <= len(u):
        raise InputError(f"period must be between 1 and the {len(u)} samples of the record; got {P}.")
    amplitude = np.fft.rfft(u[:P], axis=0) * (2.0 / P)
    amplitude[0] /= 2
    if P % 2 == 0:
        amplitude[-1] = amplitude[-1].real / 2
    return 2 * np.pi * np.arange(len(amplitude)) / (P * h), amplitude


def evaluate(omega: Array, amplitude: Complex, N: int, h: float) -> Array:
    """Re sum_l amplitude_l exp(i omega_l t) at t = 0, h, ..., (N-1) h: (N, nu)."""
    grid = _grid_period(omega, N, h)
    if grid is None:
        values = np.empty((N, amplitude.shape[1]))
        for first in range(0, N, 512):
            t = h * np.arange(first, min(first + 512, N))
            values[first : first + 512] = (np.exp(1j * np.outer(t, omega)) @ amplitude).real
        return values
    spectrum = np.zeros((grid, amplitude.shape[1]), dtype=complex)
    np.add.at(spectrum, np.rint(omega * grid * h / (2 * np.pi)).astype(int) % grid, amplitude)
    one = np.fft.ifft(spectrum, axis=0).real * grid
    return one[np.arange(N) % grid]


def _grid_period(omega: Array, N: int, h: float) -> int | None:
    """The number of samples P <= N after which all lines repeat, None where no P fits or lines are few."""
    if len(omega) < 16:
        return None
    base = np.min(np.diff(np.sort(omega)), initial=np.inf)
    P = round(2 * np.pi / (base * h)) if np.isfinite(base) and base > 0 else 0
    cycles = omega * P * h / (2 * np.pi)
    return P if 0 < P <= N and np.allclose(cycles, np.rint(cycles), rtol=0, atol=1e-7) else None


def line_responses(A: Array, B: Array, omega: Array, amplitude: Complex) -> Complex:
    """x (nl, nx): complex amplitudes of the steady state. Raises InputError for a line on an undamped pole."""
    poles = np.linalg.eigvals(A)
    distance = np.abs(1j * omega[:, None] - poles).min(axis=1, initial=np.inf)
    on_pole = (distance <= RESONANT * max(np.abs(poles).max(), np.abs(omega).max())) & amplitude.any(axis=1)
    if on_pole.any():
        raise InputError(
            f"a bandlimited input has a line at {omega[on_pole][0]:g} rad/s, on an undamped pole of the plant: its "
            "response grows without bound. Move the line, add damping, or use hold cubic."
        )
    x = np.zeros((len(omega), len(A)), dtype=complex)
    live = amplitude.any(axis=1)
    resolvent = 1j * omega[live, None, None] * np.eye(len(A)) - A
    x[live] = np.linalg.solve(resolvent, (amplitude[live] @ B.T)[..., None])[..., 0]
    return x


def steady_state(
    A: Array,
    B: Array,
    u: Array,
    h: float,
    period: int | None = None,
    series: tuple[Array, Complex] | None = None,
) -> Array:
    """x (N, nx) at the samples of the periodic solution of x' = A x + B u for the Fourier series of u (N, nu).

    series = (omega, amplitude) as in nouns.Signal where u is not periodic in the samples.
    """
    omega, amplitude = lines_of(u, h, period) if series is None else series
    return evaluate(omega, line_responses(A, B, omega, amplitude), len(u), h)
