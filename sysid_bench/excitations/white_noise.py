"""White Gaussian force, held between clock ticks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.signals import clock_in_samples, clocked, per_channel
from sysid_bench.nouns import Signal


@dataclass(frozen=True)
class WhiteNoise:
    """rms_N: N, one number or one per input.
    clock_samples: samples per tick; clock_s, s, overrules it and must be a multiple of h
    """

    rms_N: float | list[float] = 1.0
    clock_samples: int = 1
    clock_s: float | None = None

    def signal(self, N: int, h: float, nu: int, rng: np.random.Generator) -> Signal:
        """Raises InputError where h does not divide clock_s."""
        clock = clock_in_samples(self.clock_samples, self.clock_s, h)
        rms = per_channel(self.rms_N, nu, "excitation.rms_N")
        return Signal(rms * clocked(rng.standard_normal((-(-N // clock), nu)), clock, N), "zoh")
