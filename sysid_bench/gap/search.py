"""unexplained force at one place -> frequencies and pitches worth trying there."""

from __future__ import annotations

import numpy as np
from scipy.fft import fft, ifft

from sysid_bench.gap.locate import unexplained_force
from sysid_bench.gap.motion import Seen as SeenMotion
from sysid_bench.gap.problem import Problem, frequency_range
from sysid_bench.gap.waves import wave, waves
from sysid_bench.mechanics.effect import Seen
from sysid_bench.nouns import Array

MODULATIONS = 6  # lines tried: the strongest are not seldom those of the motion's own modes
LEAST_HEARD = 1e-6  # of the largest response: below, a line is rounding
CERTAIN = (
    12  # pitches whose response is worked out in full; the best of them are likely among the coarse best
)


class Unexplained:
    """What is left of one trace, seen as adjoint forces and at the sensors: the same for every place."""

    def __init__(self, problem: Problem, s: SeenMotion, left: np.ndarray):
        self.s = s
        self.force, self.residual = unexplained_force(problem, s, left)
        self.tones: dict[int, list[float]] = {}

    def heard(self, channel: int) -> list[float]:
        """Hz of the loudest tone in a channel, beyond what the basis explains and as it stands; looked for once."""
        if channel not in self.tones:
            raw = self.s.trace.signal(self.s.left[:, channel])
            top = self.s.trace.omega[-1]
            both = (self.residual[:, channel], raw)
            self.tones[channel] = [f for x in both for f in peaks(x, self.s.trace.h, 1, top)]
        return self.tones[channel]


class Search:
    """Values worth trying for a frequency or a pitch, read off the unexplained force at one place."""

    def __init__(self, problem: Problem, c: Array, unexplained: Unexplained, high: float):
        self.problem, self.c, self.high = problem, c, high
        self.s, self.unexplained = unexplained.s, unexplained
        self.force = unexplained.force @ c
        self.x, self.v = self.s.q @ c, self.s.v @ c

    def __call__(self, kind: str) -> list[float]:
        if kind == "pitch":
            return self._pitches()
        h = self.s.trace.h
        if kind == "tone":
            found = peaks(self.force, h, 2, self.s.trace.omega[-1])
            for channel in self._listening():
                found += self.unexplained.heard(channel)
            return sorted(set(found))
        carrier, count = (self.v, 3) if kind == "damping modulation" else (self.x, MODULATIONS)
        return peaks(self.force * carrier, h, count, 2.2 * self.high, self._responses(carrier))

    def _responses(self, carrier: Array) -> Array:
        """(N,) energy of what the plant makes of the carrier, moved by so many bins: near a mode far more than elsewhere."""
        plant, F = np.zeros(len(carrier)), self.s.trace.F
        plant[:F] = self._passes()
        plant[1:][::-1][: F - 1] = plant[1:F]
        return np.real(ifft(fft(plant) * np.conj(fft(_power(fft(carrier))))))

    def _passes(self) -> Array:
        """(F,) energy that the plant makes of a unit force here, over the noise, in each bin."""
        g = (self.s.G[:, :, : len(self.c)] @ self.c) * self.s.trace.weight
        return np.sum(np.abs(g) ** 2, axis=1)

    def _listening(self) -> list[int]:
        """Channels in which a tone at this place is heard: all of a few, else its own sensor, else the loudest."""
        C, c = self.problem.model.output_map, self.c
        if len(C) <= 3:
            return list(range(len(C)))
        own = np.abs(C @ c)
        heard = own if own.max() > 0 else np.sum(np.abs(self.s.G[:, :, : len(c)] @ c) ** 2, axis=0)
        return [int(np.argmax(heard))]

    def _pitches(self) -> list[float]:
        """Largest |sum force exp(i k x)| against the size of its response.

        Sums of neighbours tell which are worth the whole transform: their spectrum is that of the wave but for what
        lies beyond, which they damp.
        """
        s, x = self.s, self.x
        F, rms = s.trace.F, max(x.std(), 1e-300)
        ks = np.concatenate([np.arange(1.2, 8, 0.2), np.arange(8, 24, 0.4)]) / rms
        force = self.force / max(np.abs(self.force).max(), 1e-300)  # single precision ends at 1e38
        fold = int(np.clip(len(x) // (2 * F + 1), 1, 8))
        energy = self._passes()
        match, sums = waves(ks, x, force, fold)
        size = _power(fft(sums, axis=1)[:, :F]) @ (energy / _damped(F, len(x), fold))
        likely = np.argsort(-match / np.maximum(size, 1e-300))[:CERTAIN]
        if fold > 1:
            size = _power(fft(wave(ks[likely], x), axis=1)[:, :F]) @ energy
            likely = likely[np.argsort(-match[likely] / np.maximum(size, 1e-300))]
        return [float(2 * np.pi / ks[k]) for k in likely[:4]]


def _power(X: np.ndarray) -> Array:
    return np.real(X) ** 2 + np.imag(X) ** 2


def _damped(F: int, N: int, fold: int) -> Array:
    """(F,) share of the energy that the sums of `fold` neighbours keep in each bin, of sums as large as one sample."""
    half = np.pi * np.arange(1, F) / N
    return np.concatenate([[1.0], (np.sin(fold * half) / (fold * np.sin(half))) ** 2])


def peaks(x: Array, h: float, count: int, top: float, size: Array | None = None) -> list[float]:
    """Hz of the strongest lines of x below top rad/s; against the size (len(x),) of what would make them, where given."""
    N = 4 * len(x)
    step = 2 * np.pi / (N * h)
    last, found = min(int(np.ceil(top / step)), N // 2 + 1), []
    power = _power(np.fft.rfft(x, N)[:last])
    if size is not None:
        power /= np.maximum(size[np.arange(last) // 4], LEAST_HEARD * size.max())
    for _ in range(count):
        k = 3 + int(np.argmax(power[3:]))
        found.append(k / (N * h))
        power[max(k - 8, 0) : k + 9] = 0
    return found


def sizes(problem: Problem, s: SeenMotion, c: Array, channel: int | None, search) -> Seen:
    """What a suspect may know of its place."""
    x, v = s.q @ c, s.v @ c
    u = s.trace.u if channel is None else s.trace.u[:, [channel]]
    low, high = frequency_range(problem.model, s.trace)
    fastest = np.abs(np.diff(u, axis=0)).max() if len(u) else 0.0
    return Seen(
        float(x.std()), float(np.abs(x).max()), float(v.std()), float(u.std()), float(np.abs(u).max()),
        float(fastest), s.trace.h, s.trace.N * s.trace.h, low, high, search,
    )  # fmt: skip
