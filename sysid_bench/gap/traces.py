"""records -> traces: what the gap workflow works on, whitened and cut to the band where something can be told.

Everything after this lives on the DFT bins of that band: a few hundred complex numbers per channel.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from sysid_bench.gap.colour import Floor, coloured
from sysid_bench.mechanics.stages import stage_values
from sysid_bench.nouns import Array, InputError, Model, Record

SMOOTHING_BINS = 21


@dataclass(frozen=True, eq=False)
class Trace:
    """One record: u (N, nu), y (N, ny), h s, good (N,) bool; F bins up to the band's end; weight (F, ny); variance (ny,) of the noise."""

    u: Array
    y: Array
    h: float
    t0: float
    good: np.ndarray
    hold: str
    period: int | None
    F: int = 0
    weight: Array = field(default_factory=lambda: np.zeros((0, 0)))
    variance: Array = field(default_factory=lambda: np.zeros(0))
    pull: Array | None = None  # (N, n) N, further forces on each DOF at the samples
    part_of: tuple[Trace, int] | None = None  # a longer trace, and the sample of it where this one begins
    begins: Array | None = None  # (2 n,) state as it was measured where a part begins
    _stages: dict = field(default_factory=dict)

    @property
    def N(self) -> int:
        return len(self.y)

    @property
    def t(self) -> Array:
        return self.t0 + self.h * np.arange(self.N)

    @property
    def omega(self) -> Array:
        """(F,) rad/s of the bins of the band."""
        return 2 * np.pi * np.arange(self.F) / (self.N * self.h)

    def stages(self, substeps: int, hold: str | None = None) -> Array:
        """(S, 3, nu) stage values of the input, computed once."""
        key = (substeps, hold or self.hold)
        if self.part_of is not None:
            whole, first = self.part_of
            return whole.stages(*key)[first * substeps : (first + self.N - 1) * substeps]
        if key not in self._stages:
            self._stages[key] = stage_values(self.u, self.h, key[1], substeps, None, self.period)
        return self._stages[key]

    def pulls(self, substeps: int) -> Array | None:
        """(S, 3, n) stage values of the further forces, computed once; None where there are none."""
        if self.pull is None:
            return None
        key = (substeps, "pull")
        if key not in self._stages:
            self._stages[key] = stage_values(self.pull, self.h, "cubic", substeps)
        return self._stages[key]

    def filled(self, residual: Array) -> Array:
        """Residual (N, ny) with straight lines over samples that are not good."""
        if self.good.all():
            return residual
        k = np.arange(self.N)
        return np.column_stack([np.interp(k, k[self.good], c[self.good]) for c in residual.T])

    def spectrum(self, x: Array) -> np.ndarray:
        """(F, ...) DFT of x (N, ...) in the band."""
        return np.fft.rfft(x, axis=0)[: self.F]

    def signal(self, X: np.ndarray) -> Array:
        """(N, ...) real signal of a spectrum (F, ...)."""
        full = np.zeros((self.N // 2 + 1, *X.shape[1:]), dtype=complex)
        full[: self.F] = X
        return np.fft.irfft(full, self.N, axis=0)

    def rows(self, X: np.ndarray) -> Array:
        """(2 F ny, ...) whitened real rows of spectra (F, ny, ...): unit variance where X is measurement noise."""
        W = X * self.weight.reshape(*self.weight.shape, *([1] * (X.ndim - 2)))
        W = W.reshape(-1, *X.shape[2:])
        return np.concatenate([np.real(W), np.imag(W)])


def trace_of(record: Record, model: Model) -> Trace:
    """Trace of one record, before its band is known. Raises InputError where record and model do not fit."""
    if record.nu != model.nu or record.ny != model.ny:
        raise InputError(
            f"the model has {model.nu} input(s) and {model.ny} output(s); the record has {record.nu} and "
            f"{record.ny}. Check input_map and output_map."
        )
    unflagged = np.ones(record.N, dtype=bool) if record.quality is None else np.equal(record.quality, 0)
    good = unflagged & np.isfinite(record.y).all(axis=1) & np.isfinite(record.u).all(axis=1)
    hold = model.hold or record.hold or "zoh"
    told = np.isfinite(record.u).all(axis=1, keepdims=True)
    y, u = np.where(told, np.nan_to_num(record.y), 0.0), np.where(told, record.u, 0.0)
    t, h = record.t, None
    if record.is_uniform:
        h = record.h
    else:
        t, u, y, good, h = _regular(record, u, y, good, hold)
    if good.sum() < 20 * (model.n + 1):
        raise InputError(f"{good.sum()} good samples are too few for {model.n} degree(s) of freedom.")
    k, y_given = np.arange(len(y)), y
    if not good.all():
        y = np.column_stack([np.interp(k, k[good], c[good]) for c in y.T])
        u = _filled_input(u, good | _input_known(u, y_given, good), hold)
    return Trace(u, y, h, float(t[0]), good, hold, record.period)


def _input_known(u: Array, y: Array, good: np.ndarray) -> np.ndarray:
    """(N,) True where a flagged row still tells the input: it is no blank, no copy of the row before, and in range."""
    rows = np.hstack([u, y])
    blank = np.all(rows == 0, axis=1) | np.all(np.diff(rows, axis=0, prepend=rows[:1] + 1) == 0, axis=1)
    return ~blank & np.all(np.abs(u) <= 1.001 * np.abs(u[good]).max(axis=0), axis=1)


def _filled_input(u: Array, good: np.ndarray, hold: str) -> Array:
    """The input with what its hold makes of unknown samples; a smooth one by a curve that does not overshoot (Akima 1970)."""
    if hold == "zoh":
        last = np.maximum.accumulate(np.where(good, np.arange(len(u)), 0))
        return u[last]
    k = np.arange(len(u))
    if hold == "foh":
        return np.column_stack([np.interp(k, k[good], c[good]) for c in u.T])
    from scipy.interpolate import Akima1DInterpolator  # slow to load, and rarely needed

    known = k[good]
    return Akima1DInterpolator(known, u[good], method="makima")(np.clip(k, known[0], known[-1]))


def _regular(record: Record, u: Array, y: Array, good: np.ndarray, hold: str):
    """A record with holes on its regular grid; the holes are not good."""
    h = float(np.median(np.diff(record.t)))
    place = np.rint((record.t - record.t[0]) / h).astype(int)
    jitter = np.abs((record.t - record.t[0]) / h - place).max()
    if jitter > 0.2 or len(np.unique(place)) < len(place):
        raise InputError(
            f"the samples lie up to {jitter:.2g} steps off a regular grid of {h:g} s; the gap workflow needs a "
            "constant step, with holes at most. Resample the record."
        )
    N = place[-1] + 1
    grid = record.t[0] + h * np.arange(N)
    full_good = np.zeros(N, dtype=bool)
    full_good[place] = good
    full_u, full_y = np.zeros((N, u.shape[1])), np.zeros((N, y.shape[1]))
    full_u[place], full_y[place] = u, y
    return grid, full_u, full_y, full_good, h


def white_floor(trace: Trace, residual: Array, lattice: Array) -> Array:
    """(ny,) noise variance: the residual's median periodogram above 0.6 Nyquist, and a lattice's step^2 / 12."""
    return _white(trace, _periodogram(trace, residual), lattice)


def noise_floor(trace: Trace, residual: Array, lattice: Array, omega_max: float = 0.0) -> Floor:
    """The noise with its colour, where it has one.

    omega_max: rad/s of the fastest mode; well above it only noise is heard.
    """
    window = np.hanning(trace.N)[:, None] / np.sqrt(0.375)  # else the ends leak a slope into every frequency
    R = _periodogram(trace, residual * window)
    variance = _white(trace, R, lattice)
    phi = np.zeros(len(variance))
    for c in np.flatnonzero(lattice == 0):
        found = coloured(R[:, c], 2 * omega_max * trace.h / np.pi)
        if found is not None:
            variance[c], phi[c] = found
    return Floor(variance, phi)


def _periodogram(trace: Trace, residual: Array) -> Array:
    return np.abs(np.fft.rfft(trace.filled(residual), axis=0)) ** 2 / trace.N


def _white(trace: Trace, R: Array, lattice: Array) -> Array:
    floor = np.median(R[int(0.6 * len(R)) :], axis=0) / np.log(2)
    scale = np.mean(trace.y**2, axis=0)
    return np.maximum(np.maximum(floor, lattice**2 / 12), 1e-14 * scale + 1e-300)


def band_end(trace: Trace, floor: Floor, omega_max: float) -> float:
    """rad/s up to which the record says anything: where its smoothed spectrum still stands above the noise."""
    S = np.abs(np.fft.rfft(trace.y, axis=0)) ** 2 / trace.N
    kernel = np.ones(SMOOTHING_BINS) / SMOOTHING_BINS
    omega = 2 * np.pi * np.fft.rfftfreq(trace.N, trace.h)
    noise = floor.density(omega * trace.h)
    top = 0.0
    for c in range(S.shape[1]):
        above = np.flatnonzero(np.convolve(S[:, c], kernel, "same") > 2.5 * noise[:, c])
        top = max(top, float(omega[above[-1]]) if len(above) else 0.0)
    return min(max(1.5 * omega_max, 1.15 * top), 0.5 * np.pi / trace.h, 6 * omega_max)


def banded(trace: Trace, floor: Floor, end: float) -> Trace:
    """The trace with its band and weights set."""
    omega = 2 * np.pi * np.fft.rfftfreq(trace.N, trace.h)
    F = max(int(np.searchsorted(omega, end)), 8)
    share = np.mean(trace.good)
    weight = np.sqrt(2 / (trace.N * share)) / np.sqrt(floor.density(omega[:F] * trace.h))
    weight[0] /= np.sqrt(2)  # the mean has no imaginary part to share its noise with
    return replace(trace, F=F, weight=weight, variance=floor.variance)
