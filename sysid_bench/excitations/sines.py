"""A few sines at named frequencies."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sysid_bench.mechanics.signals import per_channel
from sysid_bench.nouns import InputError, Signal


@dataclass(frozen=True)
class Sines:
    """frequencies_hz: Hz; amplitude_N: N, one number or one per frequency
    phases_rad: one per frequency, u = sum of amplitude cos(2 pi f t + phase) on every input; null: random, of
    its own on every input
    whole_periods: true: each frequency is moved to the nearest line of the record, which is then one period and
    band-limited; false: as given, and the force is the spline through its samples
    """

    frequencies_hz: list[float] = field(default_factory=lambda: [0.1])
    amplitude_N: float | list[float] = 1.0
    phases_rad: list[float] | None = None
    whole_periods: bool = True

    def signal(self, N: int, h: float, nu: int, rng: np.random.Generator) -> Signal:
        """Raises InputError for frequencies outside (0, half the sampling rate)."""
        f = np.atleast_1d(np.asarray(self.frequencies_hz, dtype=float))
        if not f.size or np.any(f <= 0) or np.any(f >= 0.5 / h):
            raise InputError(
                f"excitation.frequencies_hz must lie above 0 and below half the sampling rate ({0.5 / h:g} Hz); got "
                f"{self.frequencies_hz}."
            )
        amplitude = per_channel(self.amplitude_N, len(f), "excitation.amplitude_N")
        if self.phases_rad is None:
            phases = rng.uniform(0, 2 * np.pi, (len(f), nu))
        else:
            phases = np.tile(per_channel(self.phases_rad, len(f), "excitation.phases_rad")[:, None], nu)
        if self.whole_periods:
            f = np.clip(np.rint(f * N * h), 1, (N - 1) // 2) / (N * h)
        angle = 2 * np.pi * f[:, None] * h * np.arange(N)
        u = np.einsum("l,lkj->kj", amplitude, np.cos(angle[:, :, None] + phases[:, None, :]))
        if not self.whole_periods:
            return Signal(u, "cubic")
        return Signal(u, "bandlimited", N, (2 * np.pi * f, amplitude[:, None] * np.exp(1j * phases)))
