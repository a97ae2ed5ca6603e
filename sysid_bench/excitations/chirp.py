"""A sine whose frequency sweeps through a band, on one input after the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import chirp
from scipy.signal.windows import tukey

from sysid_bench.mechanics.signals import per_channel
from sysid_bench.nouns import InputError, Signal

SWEEPS = ("linear", "logarithmic")


@dataclass(frozen=True)
class Chirp:
    """f_start_hz, f_end_hz: Hz; null: one cycle in the sweep's time, a quarter of the sampling rate.
    sweep: linear | logarithmic in time; amplitude_N: N, one number or one per input
    taper: part of each sweep that fades in and out

    Each input has 1/nu of the record to itself. Between samples the force is the spline through them.
    """

    f_start_hz: float | None = None
    f_end_hz: float | None = None
    sweep: str = "linear"
    amplitude_N: float | list[float] = 1.0
    taper: float = 0.05

    def __post_init__(self) -> None:
        if self.sweep not in SWEEPS:
            raise InputError(f"excitation.sweep must be one of {', '.join(SWEEPS)}; got {self.sweep!r}.")
        if not 0 <= self.taper <= 1:
            raise InputError(f"excitation.taper must lie between 0 and 1; got {self.taper!r}.")

    def signal(self, N: int, h: float, nu: int, rng: np.random.Generator) -> Signal:
        """The seed chooses the phase. Raises InputError for a band outside (0, half the sampling rate)."""
        count = N // nu
        start = 1 / max(count * h, h) if self.f_start_hz is None else self.f_start_hz
        end = 0.25 / h if self.f_end_hz is None else self.f_end_hz
        if count < 2 or not (0 < start < 0.5 / h and 0 < end < 0.5 / h):
            raise InputError(
                f"a chirp sweeps between frequencies above 0 and below half the sampling rate ({0.5 / h:g} Hz); got "
                f"f_start_hz = {start:g}, f_end_hz = {end:g} with {count} samples for each input."
            )
        t = h * np.arange(count)
        wave = chirp(t, start, t[-1], end, self.sweep, phi=rng.uniform(0, 360)) * tukey(count, self.taper)
        u = np.zeros((N, nu))
        for j, amplitude in enumerate(per_channel(self.amplitude_N, nu, "excitation.amplitude_N")):
            u[j * count : (j + 1) * count, j] = amplitude * wave
        return Signal(u, "cubic")
