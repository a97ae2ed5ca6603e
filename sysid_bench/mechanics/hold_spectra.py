"""hold, frequency -> what the hold makes of a sampled signal there; samples -> the spectra that drive a hold."""

from __future__ import annotations

import numpy as np
from scipy.fft import rfft

from sysid_bench.mechanics.rules import rule, spline_slopes
from sysid_bench.nouns import Array, Complex, InputError, NotApplicable


def drive_spectra(u: Array, U: Complex, z: Complex, weight: Array, hold: str) -> Complex:
    """Spectra (F, J, nu) of the rule's coefficients of the steps between samples u (N, nu), zero after the last sample.

    In the first F bins of the DFT, times weight (F, 1). U (F, nu): those of u; z (F, 1) = exp(j omega h): what follows from
    one sample to the next is a turn. Raises NotApplicable for fewer than 4 samples behind a spline.
    """
    if len(u) < 4:
        raise NotApplicable(f"a hold through the samples needs at least 4 of them; the record has {len(u)}.")
    last = z * weight
    at, after = _ends_of_steps(u, U, z, last)
    if hold == "zoh":
        return at[:, None]
    if hold == "foh":
        return np.stack([at, after - at], axis=1)
    slopes = spline_slopes(u)
    slope, slope_after = _ends_of_steps(slopes, rfft(slopes, axis=0)[: len(z)] * weight, z, last)
    bend = slope + slope_after - 2 * (after - at)
    return np.stack([at, slope, after - at - slope - bend, bend], axis=1)


def _ends_of_steps(x: Array, X: Complex, z: Complex, last: Complex) -> tuple[Complex, Complex]:
    """Spectra of x (N, m) at the beginning and the end of each step, X (F, m) being those of x, last (F, 1) of its last one."""
    return X - last * x[-1], z * X - last * x[0]


def discrete_modes(poles: Complex, h: float, hold: str) -> tuple[Complex, Complex]:
    """Each mode x' = pole x + u: its discrete pole (nm,) and weights (J, nm) of the signals of `drive_spectra`."""
    values = rule(hold).functions(poles * h)
    return values[0], values[1:] * h


def hold_spectrum(omega: Array, h: float, hold: str) -> Complex:
    """What the hold makes of a sampled complex exponential at omega (rad/s, also beyond Nyquist), of its DFT.

    cubic: the cardinal spline's 3 sinc^4 / (2 + cos omega h); bandlimited: one below Nyquist, zero beyond.
    Raises InputError for another name.
    """
    x = omega * h
    sinc = np.sinc(x / (2 * np.pi))
    if hold == "zoh":
        return sinc * np.exp(-0.5j * x)
    if hold == "foh":
        return (sinc**2).astype(complex)
    if hold == "cubic":
        return (3 * sinc**4 / (2 + np.cos(x))).astype(complex)
    if hold == "bandlimited":
        return (np.abs(x) <= np.pi * (1 + 1e-12)).astype(complex)
    raise InputError(f"hold must be one of zoh, foh, cubic, bandlimited; got {hold!r}.")
