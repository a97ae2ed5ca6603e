"""sampled input and its hold -> values at the start, middle and end of every small step (S, 3, nu)."""

from __future__ import annotations

import numba as nb
import numpy as np

from sysid_bench.nouns import Array, InputError


def stage_values(
    u: Array, h: float, hold: str, substeps: int, series=None, period: int | None = None
) -> Array:
    """(S, 3, nu), S = (N-1) substeps: u(t) between the samples as its hold says; quadratic inside a small step.

    Exact for zoh and foh; for cubic and bandlimited to the third order of the small step. For bandlimited,
    `series` (omega (nl,) rad/s, amplitude (nl, nu)) is the signal; without it one period of the samples is.
    Raises InputError for an unknown hold.
    """
    N, nu = u.shape
    S = (N - 1) * substeps
    if hold == "zoh":
        held = np.repeat(u[:-1], substeps, axis=0)
        return np.repeat(held[:, None, :], 3, axis=1)
    times = np.arange(2 * S + 1) / (2 * substeps)  # in samples
    if hold == "foh":
        values = np.column_stack([np.interp(times, np.arange(N), u[:, c]) for c in range(nu)])
    elif hold == "cubic":
        values = spline_values(u, 2 * substeps)
    elif hold == "bandlimited":
        values = _bandlimited(u, times, h, series, period)
    else:
        raise InputError(f"hold must be zoh, foh, cubic or bandlimited; got {hold!r}.")
    return np.stack([values[0:-1:2], values[1::2], values[2::2]], axis=1)


def _bandlimited(u: Array, times: Array, h: float, series, period: int | None) -> Array:
    if series is None:
        period = len(u) if period is None else period
        one = np.fft.rfft(u[:period], axis=0) / period
        omega, amplitude = 2 * np.pi * np.arange(len(one)) / (period * h), one * 2
        amplitude[0] /= 2
        if period % 2 == 0:
            amplitude[-1] /= 2
        keep = np.abs(amplitude).max(axis=1) > 1e-12 * np.abs(amplitude).max()
        if keep.sum() > 200:  # dense lines: interpolate one period by zero padding
            return _padded(one, period, times)
        omega, amplitude = omega[keep], amplitude[keep]
    else:
        omega, amplitude = series
    values = np.zeros((len(times), u.shape[1]))
    for w, a in zip(omega, amplitude):
        values += np.real(np.exp(1j * w * times * h)[:, None] * a)
    return values


def _padded(one: np.ndarray, period: int, times: Array) -> Array:
    per_sample = round(1 / (times[1] - times[0]))
    fine = np.fft.irfft(one * period * per_sample, period * per_sample, axis=0)
    return fine[np.arange(len(times)) % len(fine)]


def spline_values(u: Array, per_sample: int) -> Array:
    """((N-1) per_sample + 1, nu): the not-a-knot cubic spline through the samples (N, nu), evaluated evenly."""
    if len(u) < 4:
        grid = np.arange((len(u) - 1) * per_sample + 1) / per_sample
        return np.column_stack([np.interp(grid, np.arange(len(u)), c) for c in u.T])
    return np.column_stack([_spline(np.ascontiguousarray(c), per_sample) for c in u.T])


@nb.njit(cache=True)
def _spline(y, per_sample):
    """Second derivatives by elimination (unit knots), not-a-knot: s''' continuous at the first inner knots."""
    N = len(y)
    rhs = np.empty(N)
    for k in range(1, N - 1):
        rhs[k] = 6.0 * (y[k + 1] - 2.0 * y[k] + y[k - 1])
    # not-a-knot on unit knots: m0 = 2 m1 - m2; then row 1 reads 6 m1 = rhs1
    m = np.zeros(N)
    c = np.zeros(N)
    d = np.zeros(N)
    d[1] = rhs[1] / 6.0
    for k in range(2, N - 2):
        w = 4.0 - c[k - 1]
        c[k] = 1.0 / w
        d[k] = (rhs[k] - d[k - 1]) / w
    m[N - 2] = rhs[N - 2] / 6.0
    for k in range(N - 3, 0, -1):
        m[k] = d[k] - c[k] * m[k + 1]
    m[0] = 2.0 * m[1] - m[2]
    m[N - 1] = 2.0 * m[N - 2] - m[N - 3]
    values = np.empty((N - 1) * per_sample + 1)
    for k in range(N - 1):
        for j in range(per_sample):
            b = j / per_sample
            a = 1.0 - b
            values[k * per_sample + j] = (
                a * y[k] + b * y[k + 1] + ((a * a * a - a) * m[k] + (b * b * b - b) * m[k + 1]) / 6.0
            )
    values[-1] = y[-1]
    return values
