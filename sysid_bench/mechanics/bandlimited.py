"""Fourier lines of an input -> the steady-state response at the samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sysid_bench.nouns import Array, Complex, InputError

RESONANT = 1e-9  # |i omega - pole| below this times the fastest rate in sight: no steady state to speak of


def lines_of(u: Array, h: float, period: int | None) -> tuple[Array, Complex]:
    """Fourier series (omega (nl,) rad/s, amplitude (nl, nu)) of one period of the samples u (N, nu).

    u(t) = Re sum_l amplitude_l exp(i omega_l t); a line at the Nyquist frequency is a pure cosine.
    Raises InputError for a period that is not within the record.
    """
    P = len(u) if period is None else period
    if not 0 < P <= len(u):
        raise InputError(f"period must be between 1 and the {len(u)} samples of the record; got {P}.")
    amplitude = np.fft.rfft(u[:P], axis=0) * (2.0 / P)
    amplitude[0] /= 2
    if P % 2 == 0:
        amplitude[-1] = amplitude[-1].real / 2
    return 2 * np.pi * np.arange(len(amplitude)) / (P * h), amplitude


class Lines(NamedTuple):
    """u(t) = Re sum_l amplitude_l exp(i omega_l t): omega (nl,) rad/s, amplitude (nl, nu), repeating after `period`
    samples where that is known."""

    omega: Array
    amplitude: Complex
    period: int | None


def input_lines(
    u: Array, h: float, period: int | None = None, series: tuple[Array, Complex] | None = None
) -> Lines:
    """The lines of `series` where given, else of one period of the samples u (N, nu), empty lines left out."""
    if series is None:
        omega, amplitude = lines_of(u, h, period)
        live = np.abs(amplitude).max(axis=1) > 1e-14 * np.abs(amplitude).max()
        return Lines(omega[live], amplitude[live], period or len(u))
    return Lines(np.asarray(series[0], float), np.asarray(series[1], complex), period)


def evaluate(lines: Lines, values: Complex, N: int, h: float) -> Array:
    """Re sum_l values_l exp(i omega_l t) at t = 0, h, ..., (N-1) h: values (nl, nx) -> (N, nx)."""
    if lines.period is not None:
        spectrum = np.zeros((lines.period, values.shape[1]), dtype=complex)
        bins = np.rint(lines.omega * lines.period * h / (2 * np.pi)).astype(int)
        np.add.at(spectrum, bins % lines.period, values)
        return (np.fft.ifft(spectrum, axis=0).real * lines.period)[np.arange(N) % lines.period]
    x = np.empty((N, values.shape[1]))
    for first in range(0, N, 512):
        t = h * np.arange(first, min(first + 512, N))
        x[first : first + 512] = np.real(np.exp(1j * np.outer(t, lines.omega)) @ values)
    return x


def line_responses(A: Array, B: Array, lines: Lines) -> Complex:
    """x (nl, nx): complex amplitudes of the steady state. Raises InputError for a line on an undamped pole."""
    poles, omega = np.linalg.eigvals(A), lines.omega
    distance = np.abs(1j * omega[:, None] - poles).min(axis=1, initial=np.inf)
    on_pole = distance <= RESONANT * max(np.abs(poles).max(), np.abs(omega).max())
    if on_pole.any():
        raise InputError(
            f"a bandlimited input has a line at {omega[on_pole][0]:g} rad/s, on an undamped pole of the plant: its "
            "response grows without bound. Move the line, add damping, or use hold cubic."
        )
    resolvent = 1j * omega[:, None, None] * np.eye(len(A)) - A
    return np.linalg.solve(resolvent, (lines.amplitude @ B.T)[..., None])[..., 0]


def steady_state(A: Array, B: Array, lines: Lines, N: int, h: float) -> Array:
    """x (N, nx) at the samples of the periodic solution of x' = A x + B u for the lines of u."""
    return evaluate(lines, line_responses(A, B, lines), N, h)
