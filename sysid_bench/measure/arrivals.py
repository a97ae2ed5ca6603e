"""frames of a device without counters, as they arrive -> samples; afterwards, numbers for them by their times."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from sysid_bench.frames.codec import Decoded
from sysid_bench.measure.samples import COUNTS, Sample
from sysid_bench.nouns import Array

LOOK_AHEAD = 25
LOST_LAG = 0.6


class Arrivals:
    """Same face as samples.Assembler: sample i is the i-th arrival, under force i, which the arrival before called for."""

    def __init__(self, rig: Any, u: Array) -> None:
        self.rig, self._u = rig, u
        self.counts = dict.fromkeys(COUNTS.split(), 0)
        self.newest = -1
        self._waiting: list[Sample] = []
        self._partial: dict[str, Decoded] = {}

    def add(self, decoded: Decoded) -> int | None:
        """Take a feedback frame; a sample is whole when each feedback message has come."""
        if not decoded.intact:
            self.counts["corrupted"] += 1
            return None
        self.counts["received"] += 1
        self._partial[decoded.message] = decoded
        if len(self._partial) < len(self.rig.feedback_messages):
            return None
        self.newest += 1
        parts, self._partial = self._partial, {}
        y = [parts[c.message].values[c.signal] * c.scale for c in self.rig.output_channels]
        u = self._u[min(self.newest, len(self._u) - 1)]
        host_s = max(part.time for part in parts.values())
        self._waiting.append(Sample(self.newest, -1, host_s, u, np.array(y), 0))
        return self.newest

    def ready(self) -> Iterator[Sample]:
        samples, self._waiting = self._waiting, []
        yield from samples

    def flush(self) -> Iterator[Sample]:
        return self.ready()


def number_arrivals(host_s: Array, h: float) -> tuple[np.ndarray, float]:
    """(k (N,) numbers of arrivals at host_s (N,), the period in s that fits them best), nominal period h.

    A frame cannot come before its sample: the lag host - start - k h only shows delay, which comes and goes. A
    lag that stays up for the next 25 arrivals is frames lost; they are missing where the gap is widest.
    """
    k = np.arange(len(host_s))
    for _ in range(3):  # numbers, then the period by those numbers, again
        h = _period(k, host_s, h)
        k = _number(host_s, h)
    return k, h


def _number(host_s: Array, h: float) -> np.ndarray:
    k = np.arange(len(host_s))
    start = np.median(np.sort(host_s[:LOOK_AHEAD] - h * k[:LOOK_AHEAD])[:5])
    gaps = np.diff(host_s, prepend=host_s[0])
    i = 1
    while i < len(host_s):
        lag = (host_s[i : i + LOOK_AHEAD] - start) / h - k[i : i + LOOK_AHEAD]
        if lag.min() > LOST_LAG:
            first = i + int(np.argmax(gaps[i : i + 3]))
            k[first:] += round(float(lag.min()))
            i = first
        else:
            start += 0.02 * h * float(np.clip(lag.min(), -1, 1))  # follows slow drift
        i += 1
    return k


def _period(k: np.ndarray, host_s: Array, h: float) -> float:
    """Median slope over long spans, kept within 2 % of nominal."""
    span = max(1, len(k) // 2)
    slopes = (host_s[span:] - host_s[:-span]) / (k[span:] - k[:-span])
    return float(np.clip(np.median(slopes), 0.98 * h, 1.02 * h)) if len(slopes) else h
