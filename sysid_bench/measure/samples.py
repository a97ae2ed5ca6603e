"""frames of the device, in whatever order and number they come -> numbered samples with quality, and counts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sysid_bench.frames.codec import Decoded
from sysid_bench.frames.counter import unwrap
from sysid_bench.nouns import CLIPPED, CORRUPTED, DUPLICATED, LOST, REORDERED, Array

WINDOW_S = 0.2
COUNTS = "received lost duplicated reordered corrupted late clipped forces_missed forces_uncertain sync_lost too_late"


@dataclass
class Row:
    """What is known of one sample: outputs by message, whether force messages were missed, its tick, arrival."""

    k: int
    values: dict[str, dict[str, float]] = field(default_factory=dict)
    missed: dict[str, bool] = field(default_factory=dict)
    missed_total: int | None = None
    tick: int | None = None
    host_s: float = float("nan")
    quality: int = 0


@dataclass(frozen=True)
class Sample:
    """A sample for the log: u (nu,) as applied, y (ny,) with NaN where lost, tick -1 where unknown."""

    k: int
    tick: int
    host_s: float
    u: Array
    y: Array
    quality: int


class Assembler:
    """Puts the numbered frames of a run together; samples leave in order, WINDOW_S after their first frame."""

    def __init__(self, rig: Any, u: Array) -> None:
        self.rig, self._u = rig, u
        self.counts = dict.fromkeys(COUNTS.split(), 0)
        self.newest = -1
        self._next = 0
        self._window = max(16, round(WINDOW_S * rig.rate_hz))
        self._rows: dict[int, Row] = {}
        self._last_of: dict[str, int] = {}
        self._corrupt_at: dict[str, int] = {}
        self._first_tick: int | None = None
        self._applied: dict[str, Array] = {}
        self._missed_before = 0
        self._force_of = dict(zip(rig.feedback_messages, rig.force_messages))
        if len(rig.feedback_messages) != len(rig.force_messages):
            self._force_of = {}
        self._extremes = [_extremes(rig, c) for c in rig.output_channels]

    def add(self, decoded: Decoded) -> int | None:
        """Take sync or feedback; its sample's number, None where the frame is of no use."""
        rig, name = self.rig, decoded.message
        if not decoded.intact:
            self._corrupted(name)
            return None
        expected = self._last_of.get(name, self.newest) + 1
        k = unwrap(int(decoded.values[rig.counter]), rig.bits(name, rig.counter), max(expected, self.newest))
        if k < self._next or k >= len(self._u) + self._window:
            self.counts["too_late"] += 1
            return None
        row = self._rows.setdefault(k, Row(k))
        self.counts["received"] += 1
        if name in row.values:
            self.counts["duplicated"] += 1
            row.quality |= DUPLICATED
            return None
        if k < self._last_of.get(name, -1):
            self.counts["reordered"] += 1
            row.quality |= REORDERED
        self._last_of[name] = max(k, self._last_of.get(name, -1))
        self.newest = max(self.newest, k)
        self._take(row, decoded)
        return k

    def _take(self, row: Row, decoded: Decoded) -> None:
        rig, name, values = self.rig, decoded.message, decoded.values
        row.values[name] = values
        row.host_s = decoded.time if np.isnan(row.host_s) else max(row.host_s, decoded.time)
        if rig.has(name, rig.tick):
            row.tick = self._tick(row.k, int(values[rig.tick]), rig.bits(name, rig.tick))
        if rig.missed and rig.has(name, rig.missed):
            if name == rig.sync:
                row.missed_total = int(values[rig.missed])
            elif name in self._force_of:
                row.missed[self._force_of[name]] = bool(values[rig.missed])

    def _tick(self, k: int, value: int, bits: int) -> int:
        per_sample = 1 / (self.rig.rate_hz * self.rig.tick_unit_s)
        if self._first_tick is None:
            self._first_tick = value - round(k * per_sample)
        return unwrap(value, bits, self._first_tick + round(k * per_sample))

    def _corrupted(self, name: str) -> None:
        """A frame that cannot be trusted, its number included: it is missed where the next one was expected."""
        self.counts["corrupted"] += 1
        if name in self.rig.feedback_messages:
            last = self._last_of.get(name, -1)
            k = min(max(last, self._corrupt_at.get(name, -1)) + 1, max(self.newest, last + 1))
            self._corrupt_at[name] = k
            self._rows.setdefault(k, Row(k)).quality |= CORRUPTED

    def ready(self) -> Iterator[Sample]:
        """Samples that nothing more is expected for, in order."""
        while self._next <= self.newest - self._window:
            yield self._finish()

    def flush(self) -> Iterator[Sample]:
        """All that remains, at the end of a run."""
        while self._next <= self.newest:
            yield self._finish()

    def _finish(self) -> Sample:
        k = self._next
        row = self._rows.setdefault(k, Row(k))
        u, missed = self._force(row)
        y = self._outputs(row)
        if self.rig.sync and self.rig.sync not in row.values:
            self.counts["sync_lost"] += 1
        if missed:
            self.counts["forces_missed"] += missed
            row.quality |= LOST
        self._missed_before = self._missed_before + missed if row.missed_total is None else row.missed_total
        self._next += 1
        del self._rows[k]
        tick = -1 if row.tick is None else row.tick
        return Sample(k, tick, row.host_s, u, y, row.quality)

    def _outputs(self, row: Row) -> Array:
        y = np.full(len(self.rig.output_channels), np.nan)
        for i, channel in enumerate(self.rig.output_channels):
            values = row.values.get(channel.message)
            if values is not None:
                raw = values[channel.signal]
                y[i] = raw * channel.scale
                if raw in self._extremes[i]:
                    row.quality |= CLIPPED
        absent = sum(m not in row.values for m in self.rig.feedback_messages)
        if absent:
            self.counts["lost"] += absent
            row.quality |= LOST
        self.counts["clipped"] += bool(row.quality & CLIPPED)
        return y

    def _force(self, row: Row) -> tuple[Array, int]:
        """(u (nu,) that the device held from tick k on, how many force messages it missed)."""
        rig, missed = self.rig, self._missed(row)
        commanded = self._u[min(row.k, len(self._u) - 1)]  # past its end a run repeats its last force
        u = commanded.copy()
        for i, channel in enumerate(rig.input_channels):
            if missed.get(channel.message) and channel.message in self._applied:
                u[i] = self._applied[channel.message][i]
        for message in rig.force_messages:
            self._applied[message] = u
        return u, sum(missed.values())

    def _missed(self, row: Row) -> dict[str, bool]:
        """By force message; where its feedback is lost too, the running total in the next sync decides."""
        if self.rig.missed is None:
            return {}
        unknown = [m for m in self.rig.force_messages if m not in row.missed]
        if not unknown:
            return row.missed
        open_slots, known, total = self._span(row.k)
        rest = None if total is None else total - known
        if rest == 0 or rest == open_slots:
            return row.missed | dict.fromkeys(unknown, rest != 0)
        self.counts["forces_uncertain"] += len(unknown)
        return row.missed

    def _span(self, k: int) -> tuple[int, int, int | None]:
        """(slots not known, misses known, misses in all) from sample k to the next one with a total."""
        open_slots = known = 0
        per_row = len(self.rig.force_messages)
        for j in range(k, self.newest + 1):
            row = self._rows.get(j, Row(j))
            open_slots += per_row - len(row.missed)
            known += sum(row.missed.values())
            if row.missed_total is not None:
                span = 1 << self.rig.bits(self.rig.sync, self.rig.missed)
                return open_slots, known, (row.missed_total - self._missed_before) % span
        return open_slots, known, None


def _extremes(rig: Any, channel: Any) -> tuple[float, ...]:
    """Values of a signal at the ends of its range: a sensor that shows them is clipped."""
    signal = rig.database.get_message_by_name(channel.message).get_signal_by_name(channel.signal)
    if signal.is_float:
        return ()
    bits = signal.length
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signal.is_signed else (0, (1 << bits) - 1)
    return low * signal.scale + signal.offset, high * signal.scale + signal.offset
