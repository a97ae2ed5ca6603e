"""Two-level forces: maximum-length shift-register sequences and coin tosses, held between clock ticks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import max_len_seq

from sysid_bench.mechanics.signals import clock_in_samples, clocked, per_channel
from sysid_bench.nouns import Array, InputError, Signal

SEQUENCES = ("maximum_length", "random")


@dataclass(frozen=True)
class PRBS:
    """sequence: maximum_length (period 2^register_bits - 1 ticks; each input gets it shifted by its share of the
    period) | random (independent coin tosses).
    register_bits: 2 to 20, null: the shortest register that does not repeat within the record
    clock_samples: samples per tick; clock_s, s, overrules it and must be a multiple of h
    amplitude_N: the levels are +- this, N; one number or one per input
    """

    sequence: str = "maximum_length"
    register_bits: int | None = None
    clock_samples: int = 1
    clock_s: float | None = None
    amplitude_N: float | list[float] = 1.0

    def __post_init__(self) -> None:
        if self.sequence not in SEQUENCES:
            raise InputError(
                f"excitation.sequence must be one of {', '.join(SEQUENCES)}; got {self.sequence!r}."
            )
        if self.register_bits is not None and not 2 <= self.register_bits <= 20:
            raise InputError(f"excitation.register_bits must be 2 to 20; got {self.register_bits!r}.")

    def signal(self, N: int, h: float, nu: int, rng: np.random.Generator) -> Signal:
        """Raises InputError where h does not divide clock_s."""
        clock = clock_in_samples(self.clock_samples, self.clock_s, h)
        ticks = -(-N // clock)
        period = None
        if self.sequence == "random":
            levels = rng.choice([-1.0, 1.0], size=(ticks, nu))
        else:
            levels, length = self._register(ticks, nu, rng)
            period = length * clock if length * clock <= N else None
        amplitude = per_channel(self.amplitude_N, nu, "excitation.amplitude_N")
        return Signal(amplitude * clocked(levels, clock, N), "zoh", period)

    def _register(self, ticks: int, nu: int, rng: np.random.Generator) -> tuple[Array, int]:
        bits = self.register_bits or min(max(int(np.ceil(np.log2(ticks + 1))), 2), 20)
        one = 2.0 * max_len_seq(bits)[0] - 1.0
        start = rng.integers(len(one)) + np.arange(nu) * len(one) // nu
        return one[(np.arange(ticks)[:, None] + start) % len(one)], len(one)
