"""Random-phase multisine: a periodic force with exactly chosen lines, band-limited between samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid_bench.mechanics.signals import low_crest_phases, per_channel
from sysid_bench.nouns import InputError, Signal

GRIDS = ("full", "odd", "odd_random")


@dataclass(frozen=True)
class Multisine:
    """grid: full (all lines) | odd (even ones free: even nonlinearities show there) | odd_random (of each four odd
    lines one, at random, free as well: odd nonlinearities show there).
    periods: whole periods of N // periods samples in the record, the rest a part of one more
    f_min_hz, f_max_hz: band, Hz; null: the lowest line, the highest below half the sampling rate
    rms_N: N, one number or one per input; all lines equal
    own_lines: true: each line drives one input only, in turn (separates the inputs within one period)
    crest_iterations: 0 leaves the phases random; 100 brings the crest factor from about 3.5 to below 2
    """

    grid: str = "full"
    periods: int = 1
    f_min_hz: float | None = None
    f_max_hz: float | None = None
    rms_N: float | list[float] = 1.0
    own_lines: bool = False
    crest_iterations: int = 0

    def __post_init__(self) -> None:
        if self.grid not in GRIDS:
            raise InputError(f"excitation.grid must be one of {', '.join(GRIDS)}; got {self.grid!r}.")
        if self.periods < 1:
            raise InputError(f"excitation.periods must be at least 1; got {self.periods!r}.")

    def signal(self, N: int, h: float, nu: int, rng: np.random.Generator) -> Signal:
        """Raises InputError where the band holds no line."""
        P = N // self.periods
        lines = self.lines(P, h, rng)
        shares = [lines[j::nu] if self.own_lines else lines for j in range(nu)]
        if min(map(len, shares)) == 0:
            raise InputError(
                f"a multisine of {self.periods} period(s) in {N} samples of {h:g} s has too few lines between "
                f"f_min_hz = {self.f_min_hz} and f_max_hz = {self.f_max_hz}; its lines are {1 / max(P * h, h):g} Hz "
                "apart. Lengthen the period or widen the band."
            )
        amplitude = np.zeros((P // 2 + 1, nu), dtype=complex)
        for j, (share, rms) in enumerate(zip(shares, per_channel(self.rms_N, nu, "excitation.rms_N"))):
            size = np.full(len(share), rms * np.sqrt(2 / len(share)))
            phases = rng.uniform(0, 2 * np.pi, len(share))
            if self.crest_iterations:
                phases = low_crest_phases(share, size, phases, self.crest_iterations)
            amplitude[share, j] = size * np.exp(1j * phases)
        one = np.fft.irfft(amplitude * P / 2, P, axis=0)
        omega = 2 * np.pi * lines / (P * h)
        return Signal(one[np.arange(N) % P], "bandlimited", P, (omega, amplitude[lines]))

    def lines(self, P: int, h: float, rng: np.random.Generator) -> NDArray[np.intp]:
        """Driven lines, in periods of P samples of h seconds."""
        k = np.arange(1, (P + 1) // 2)
        f = k / (P * h) if P else k
        low, high = self.f_min_hz or 0.0, np.inf if self.f_max_hz is None else self.f_max_hz
        k = k[(f >= low * (1 - 1e-9)) & (f <= high * (1 + 1e-9))]
        if self.grid == "full":
            return k
        k = k[k % 2 == 1]
        if self.grid == "odd":
            return k
        left_out = 4 * np.arange(len(k) // 4) + rng.integers(4, size=len(k) // 4)
        return np.delete(k, left_out)
