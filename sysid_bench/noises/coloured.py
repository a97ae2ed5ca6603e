"""Gaussian measurement noise with a spectrum: autoregressive, or a low-pass of first or second order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from sysid_bench.mechanics.snr import noise_variance
from sysid_bench.nouns import Array, InputError


@dataclass(frozen=True)
class Coloured:
    """snr_db: dB, one number or one per channel.
    ar: [a1, a2, ...] of e[k] + a1 e[k-1] + ... = white; null: a low-pass instead, sampled exactly at its poles:
    corner_hz, Hz; order 1 or 2; zeta, damping ratio of order 2
    """

    snr_db: float | list[float] = 15.0
    ar: list[float] | None = None
    corner_hz: float = 0.5
    order: int = 1
    zeta: float = 0.7

    def __post_init__(self) -> None:
        if self.order not in (1, 2) or not self.corner_hz > 0 or not self.zeta > 0:
            raise InputError(
                f"coloured noise needs order 1 or 2, corner_hz > 0 and zeta > 0; got order = {self.order}, "
                f"corner_hz = {self.corner_hz}, zeta = {self.zeta}."
            )

    def apply(self, y: Array, h: float, rng: np.random.Generator) -> tuple[Array, Array]:
        """Stationary from the first sample. Raises InputError for an unstable filter."""
        variance, denominator = noise_variance(y, self.snr_db), self.denominator(h)
        slowest = np.abs(np.roots(denominator)).max(initial=0.0)
        if slowest >= 1:
            raise InputError(
                f"noise.ar = {self.ar} is not stable: a root has magnitude {slowest:g}, not below 1."
            )
        settling = int(np.ceil(np.log(1e-8) / np.log(max(slowest, 1e-3)))) + 10
        impulse = lfilter([1.0], denominator, np.eye(1, 2 * settling)[0])
        white = rng.standard_normal((settling + len(y), y.shape[1]))
        unit = lfilter([1.0], denominator, white, axis=0)[settling:] / np.linalg.norm(impulse)
        return y + np.sqrt(variance) * unit, variance

    def denominator(self, h: float) -> Array:
        """[1, a1, ...] of the autoregression at sampling time h, s."""
        if self.ar is not None:
            return np.concatenate([[1.0], np.asarray(self.ar, dtype=float)])
        omega = 2 * np.pi * self.corner_hz
        poles = [-omega] if self.order == 1 else np.roots([1.0, 2 * self.zeta * omega, omega**2])
        return np.poly(np.exp(h * np.asarray(poles))).real
