"""What excitations share: amplitudes per input, clocks in whole samples, low crest factors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sysid_bench.mechanics.simulate import steps_within
from sysid_bench.nouns import Array, InputError


def per_channel(value: float | list[float], count: int, name: str) -> Array:
    """(count,) from one finite number or one per channel. Raises InputError for anything else."""
    values = np.atleast_1d(np.asarray(value, dtype=float))
    if values.ndim != 1 or len(values) not in (1, count) or not np.all(np.isfinite(values)):
        raise InputError(
            f"{name} must be one finite number, or one for each of {count} channels; got {value!r}."
        )
    return np.broadcast_to(values, (count,))


def clock_in_samples(clock_samples: int, clock_s: float | None, h: float) -> int:
    """Samples between two choices of a clocked signal: clock_s, where given, overrules clock_samples.

    Raises InputError where h does not divide clock_s, and for a clock below one sample.
    """
    if clock_s is not None:
        return steps_within(clock_s, h, "sampling.h_s", "excitation.clock_s")
    if clock_samples < 1:
        raise InputError(f"excitation.clock_samples must be at least 1; got {clock_samples!r}.")
    return int(clock_samples)


def clocked(choices: Array, clock: int, N: int) -> Array:
    """u (N, nu): each row of choices (>= N / clock, nu) held for `clock` samples."""
    return np.repeat(choices, clock, axis=0)[:N]


def crest_factor(u: Array) -> float:
    """Peak over rms of one channel."""
    return float(np.abs(u).max() / np.sqrt(np.mean(np.square(u))))


def low_crest_phases(
    lines: NDArray[np.intp], amplitudes: Array, phases: Array, iterations: int, oversampling: int = 4
) -> Array:
    """Phases (nl,) of a multisine with the lines (in periods) and amplitudes (nl,), started at `phases`.

    Clip the peaks, keep the phases of what results, restore the amplitudes, again; the best is kept (Van der
    Ouderaa, Schoukens & Renneboog 1988).
    """
    size = 2 * oversampling * (int(lines.max()) + 1)
    best, lowest = phases, np.inf
    for step in range(iterations + 1):
        spectrum = np.zeros(size // 2 + 1, dtype=complex)
        spectrum[lines] = amplitudes * np.exp(1j * phases)
        wave = np.fft.irfft(spectrum, size)
        crest = crest_factor(wave)
        if crest < lowest:
            best, lowest = phases, crest
        limit = np.abs(wave).max() * (0.75 + 0.2 * step / max(iterations, 1))
        phases = np.angle(np.fft.rfft(np.clip(wave, -limit, limit))[lines])
    return best
