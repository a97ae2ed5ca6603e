"""unexplained force at one place -> frequencies and pitches worth trying there."""

from __future__ import annotations

import numpy as np
from scipy.fft import fft

from sysid_bench.gap.motion import Seen as SeenMotion
from sysid_bench.gap.problem import Problem, frequency_range
from sysid_bench.mechanics.effect import Seen
from sysid_bench.nouns import Array

MODULATIONS = 6  # lines tried: the strongest are not seldom those of the motion's own modes


class Search:
    """Values worth trying for a frequency or a pitch, read off the unexplained force at one place."""

    def __init__(self, problem: Problem, s: SeenMotion, c: Array, force: Array, residual: Array, low, high):
        self.problem, self.s, self.c, self.high, self.low = problem, s, c, high, low
        self.force, self.residual = force @ c, residual
        self.x, self.v = s.q @ c, s.v @ c

    def __call__(self, kind: str) -> list[float]:
        if kind == "pitch":
            return self._pitches()
        if kind == "tone":
            raw = self.s.trace.signal(self.s.left)
            found = self._peaks(self.force, 2, self.s.trace.omega[-1])
            for channel in self._listening():
                found += self._peaks(self.residual[:, channel], 1, self.s.trace.omega[-1])
                found += self._peaks(raw[:, channel], 1, self.s.trace.omega[-1])
            return sorted(set(found))
        carrier, count = (self.v, 3) if kind == "damping modulation" else (self.x, MODULATIONS)
        return self._peaks(self.force * carrier, count, 2.2 * self.high)

    def _listening(self) -> list[int]:
        """Channels in which a tone at this place is heard: all of a few, else its own sensor, else the loudest."""
        C, c = self.problem.model.output_map, self.c
        if len(C) <= 3:
            return list(range(len(C)))
        own = np.abs(C @ c)
        heard = own if own.max() > 0 else np.sum(np.abs(self.s.G[:, :, : len(c)] @ c) ** 2, axis=0)
        return [int(np.argmax(heard))]

    def _peaks(self, x: Array, count: int, top: float) -> list[float]:
        N = 4 * len(x)
        power = np.abs(np.fft.rfft(x, N)) ** 2
        omega = 2 * np.pi * np.fft.rfftfreq(N, self.s.trace.h)
        last, found = int(np.searchsorted(omega, top)), []
        for _ in range(count):
            k = 3 + int(np.argmax(power[3:last]))
            found.append(float(omega[k] / (2 * np.pi)))
            power[max(k - 8, 0) : k + 9] = 0
        return found

    def _pitches(self) -> list[float]:
        """Largest |sum force exp(i k x)| against the size of its response."""
        s, x = self.s, self.x
        rms = max(x.std(), 1e-300)
        ks = np.concatenate([np.arange(1.2, 8, 0.2), np.arange(8, 24, 0.4)]) / rms
        waves = _waves(ks, x)
        force = self.force / max(np.abs(self.force).max(), 1e-300)  # single precision ends at 1e38
        match = np.abs(waves @ force.astype(np.float32)) ** 2
        g = (s.G[:, :, : len(self.c)] @ self.c) * s.trace.weight
        energy = np.sum(np.abs(g) ** 2, axis=1)
        size = np.abs(fft(waves, axis=1)[:, : s.trace.F]) ** 2 @ energy
        best = np.argsort(-match / np.maximum(size, 1e-300))[:4]
        return [float(2 * np.pi / ks[k]) for k in best]


def _waves(ks: Array, x: Array) -> np.ndarray:
    """(len(ks), N) exp(i k x), each from the one before: a product costs a tenth of an exponential.

    In single precision: they only rank pitches.
    """
    out = np.empty((len(ks), len(x)), dtype=np.complex64)
    steps: dict[float, np.ndarray] = {}
    out[0] = np.exp(1j * ks[0] * x)
    for j, step in enumerate(np.diff(ks), start=1):
        key = float(f"{step:.6g}")
        if key not in steps:
            steps[key] = np.exp(1j * step * x).astype(np.complex64)
        np.multiply(out[j - 1], steps[key], out=out[j])
    return out


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
