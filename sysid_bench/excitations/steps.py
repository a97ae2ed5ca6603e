"""A staircase of held force levels, on one input after the other."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sysid_bench.mechanics.signals import per_channel
from sysid_bench.nouns import InputError, Signal


@dataclass(frozen=True)
class Steps:
    """levels: the staircase, in parts of amplitude_N; dwell_s: time on each level, s, in whole samples
    amplitude_N: N, one number or one per input. The staircase runs over the first input, the second, ..., again.
    """

    levels: list[float] = field(default_factory=lambda: [1.0, 0.0, -1.0, 0.0])
    dwell_s: float = 10.0
    amplitude_N: float | list[float] = 1.0

    def signal(self, N: int, h: float, nu: int, rng: np.random.Generator) -> Signal:
        """Nothing is random. Raises InputError for a dwell below one sample or no levels."""
        dwell = round(self.dwell_s / h)
        if dwell < 1 or not len(self.levels):
            raise InputError(
                f"steps need levels, and a dwell of at least one sample ({h:g} s); got levels = {self.levels}, "
                f"dwell_s = {self.dwell_s:g}."
            )
        stairs = np.repeat(np.asarray(self.levels, dtype=float), dwell)
        amplitude = per_channel(self.amplitude_N, nu, "excitation.amplitude_N")
        one = np.kron(np.diag(amplitude), stairs[:, None])
        return Signal(one[np.arange(N) % len(one)], "zoh", len(one) if len(one) <= N else None)
