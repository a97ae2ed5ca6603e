"""How a record comes about: a signal, its noise, its sampling, and the source that acquires it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sysid_bench.nouns.plant import Plant
from sysid_bench.nouns.record import Record
from sysid_bench.nouns.words import Array, Hold, InputError

MOST_SAMPLES = 1_000_000_000  # 8 GB a channel


@dataclass(frozen=True, eq=False)
class Signal:
    """Samples of a continuous-time excitation and what it does between them.

    u (N, nu), hold as in Record, period in samples (None: not periodic). For hold "bandlimited",
    `series` is the signal itself: (omega (nl,) rad/s, amplitude (nl, nu) complex) with
    u(t) = Re sum_l amplitude_l exp(i omega_l t).
    """

    u: Array
    hold: Hold
    period: int | None = None
    series: tuple[Array, NDArray[np.complex128]] | None = None


class Excitation(Protocol):
    """A continuous-time input signal, seeded; knows its intersample behaviour."""

    def signal(self, N: int, h: float, nu: int, rng: np.random.Generator) -> Signal: ...


class Noise(Protocol):
    """What the measurement adds to (or does to) the noise-free output."""

    def apply(self, y: Array, h: float, rng: np.random.Generator) -> tuple[Array, Array]:
        """y (N, ny) noise-free -> (measured (N, ny), variance (ny,) of what was added, per channel)."""
        ...


@dataclass(frozen=True)
class Sampling:
    """N samples, h seconds apart."""

    h_s: float = 0.1
    N: int = 6000

    def __post_init__(self) -> None:
        if not (np.isfinite(self.h_s) and self.h_s > 0):
            raise InputError(f"sampling.h_s must be a positive time in s; got {self.h_s!r}.")
        if not 2 <= self.N <= MOST_SAMPLES:
            raise InputError(f"sampling.N must be 2 to {MOST_SAMPLES:,} samples; got {self.N!r}.")


@dataclass(frozen=True, eq=False)
class Acquired:
    """A record with what only the scoring side may know of it.

    y_true (N, ny) noise-free output; noise_variance (ny,). Both None for measured records.
    """

    record: Record
    y_true: Array | None = None
    noise_variance: Array | None = None


class Source(Protocol):
    """Where records come from: a simulation, a rig, a folder of files."""

    def acquire(
        self, plant: Plant, excitation: Excitation, noise: Noise, sampling: Sampling, rng: np.random.Generator
    ) -> Acquired: ...
