"""hold, frequency -> what the hold makes of a sampled signal there; samples -> the signals that drive a hold."""

from __future__ import annotations

import numpy as np

from sysid_bench.mechanics.rules import rule
from sysid_bench.nouns import Array, Complex, InputError, NotApplicable


def drives(u: Array, hold: str) -> Array:
    """The rule's coefficients of the steps between samples u (N, nu): (J, N, nu), zero after the last sample.

    Raises NotApplicable for fewer than 4 samples behind a spline.
    """
    if len(u) < 4:
        raise NotApplicable(f"a hold through the samples needs at least 4 of them; the record has {len(u)}.")
    c = rule(hold).coefficients(u)
    return np.concatenate([c, np.zeros_like(c[:, :1])], axis=1)


def discrete_modes(poles: Complex, h: float, hold: str) -> tuple[Complex, Complex]:
    """Each mode x' = pole x + u: its discrete pole (nm,) and weights (J, nm) of the signals of `drives`."""
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
