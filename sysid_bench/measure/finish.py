"""a log as it was written, whole or cut off -> a clean record file: sample times on the host's clock, flags, verdict."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap import records as mcap_records
from mcap.writer import CompressionType, Writer

from sysid_bench.files.disk import atomic_write
from sysid_bench.measure.arrivals import number_arrivals
from sysid_bench.measure.clock import ClockFit, fit_clock
from sysid_bench.nouns import LATE, LOST, STUCK, Array, InputError
from sysid_bench.records.mcap_stream import DAMAGED, stream
from sysid_bench.records.mcap_write import ORIGIN, describe, register
from sysid_bench.records.protobuf import class_from_schema

RIG_KEYS = {"k", "tick", "host_s"}


@dataclass
class Scan:
    """What a first reading of a log finds: samples by column, properties, attachments, where it broke."""

    columns: dict[str, list[float]] = field(default_factory=dict)
    properties: dict[str, Any] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    messages: int = 0
    broken: str | None = None


def items(path: Path) -> Iterator[Any]:
    """MCAP records of a file up to its end or its damage."""
    with open(path, "rb") as file:
        try:
            yield from stream(file, path.stat().st_size)
        except DAMAGED as problem:
            yield problem


def scan(path: Path) -> Scan:
    """Read all that can be read. Raises InputError where that is nothing."""
    found, schemas, channels = Scan(), {}, {}
    for item in items(path):
        if isinstance(item, Exception):
            found.broken = f"{type(item).__name__}: {item}"
        elif isinstance(item, mcap_records.Schema):
            schemas[item.id] = item
        elif isinstance(item, mcap_records.Channel):
            channels[item.id] = (
                item.topic,
                class_from_schema(schemas[item.schema_id].name, schemas[item.schema_id].data),
            )
        elif isinstance(item, mcap_records.Metadata):
            found.properties |= {
                key: json.loads(value) for key, value in item.metadata.items() if key != "format"
            }
        elif isinstance(item, mcap_records.Attachment):
            found.attachments[item.name] = item.data
        elif isinstance(item, mcap_records.Message):
            found.messages += 1
            topic, message = channels[item.channel_id]
            if topic == "/record" and "host_s" in message.DESCRIPTOR.fields_by_name:
                _add(found.columns, message.FromString(item.data))
    if not channels:
        raise InputError(f"{path}: nothing to recover; it ends before its first sample.")
    return found


def _add(columns: dict[str, list[float]], sample: Any) -> None:
    for descriptor in sample.DESCRIPTOR.fields:
        columns.setdefault(descriptor.name, []).append(getattr(sample, descriptor.name))


@dataclass(frozen=True)
class Verdict:
    """Clock and quality of a record. valid: at most `max_lost` of its samples are lost, and nothing unexplained."""

    clock: ClockFit | None
    counts: Mapping[str, int]
    lost_share: float
    valid: bool
    reason: str

    def as_origin(self) -> dict[str, Any]:
        clock = (
            None
            if self.clock is None
            else asdict(self.clock) | {"applied": self.clock.significant and self.valid}
        )
        return {
            "clock": clock, "frames": dict(self.counts), "lost_share": self.lost_share,
            "valid": self.valid, "invalid_reason": self.reason,
        }  # fmt: skip


@dataclass(frozen=True)
class Rules:
    """How a rig's samples are judged: kept in the log's origin so that `recover` judges as `measure` does."""

    rate_hz: float
    tick_unit_s: float
    numbered: bool
    late_s: float
    max_lost: float
    max_drift_ppm: float
    stuck_s: float | None


def judged(
    columns: Mapping[str, list[float]], rules: Rules, counts: Mapping[str, int]
) -> tuple[dict[str, np.ndarray], Verdict]:
    """Columns with times on the host's clock and late samples flagged, and the verdict."""
    table = {name: np.array(values) for name, values in columns.items()}
    if not rules.numbered:
        table = _numbered(table, rules)
    device_s = _device_times(table, rules)
    good = np.isfinite(table["host_s"])
    clock = fit_clock(device_s[good], table["host_s"][good])
    quality = table["quality"].astype(np.uint8)
    if clock is not None:
        late = good & (clock.delays(device_s, table["host_s"]) > rules.late_s)
        quality[late] |= LATE
    quality[_stuck(table, rules)] |= STUCK
    scale = clock.scale if clock is not None and clock.significant and not _runaway(clock, rules) else 1.0
    table["t"] = scale * (device_s - device_s[0])
    table["quality"] = quality
    counts = {**counts, "late": int(np.count_nonzero(quality & LATE))}
    counts |= {"stuck": int(np.count_nonzero(quality & STUCK))}
    if not rules.numbered:
        counts["lost"] = int(np.count_nonzero(quality & LOST))
    return table, _verdict(clock, counts, quality, rules)


def _stuck(table: Mapping[str, np.ndarray], rules: Rules) -> np.ndarray:
    """(N,) bool: samples of an output that had moved and then repeats itself bit for bit for stuck_s."""
    stuck = np.zeros(len(table["k"]), dtype=bool)
    if rules.stuck_s is None:
        return stuck
    shortest = max(2, round(rules.stuck_s * rules.rate_hz))
    for name in (name for name in table if name.startswith("y")):
        changes = np.flatnonzero(np.diff(table[name]) != 0) + 1
        for start, end in zip(changes, [*changes[1:], len(stuck)]):
            if end - start > shortest:
                stuck[start:end] = True
    return stuck


def _verdict(clock: ClockFit | None, counts: Mapping[str, int], quality: np.ndarray, rules: Rules) -> Verdict:
    share = float(np.mean(quality & LOST != 0))
    reasons = []
    if share > rules.max_lost:
        reasons.append(f"{100 * share:.2f} % of the samples are lost, more than {100 * rules.max_lost:g} %")
    if counts.get("forces_uncertain"):
        reasons.append(f"{counts['forces_uncertain']} forces are not known for certain")
    if clock is not None and clock.significant and _runaway(clock, rules):
        reasons.append(
            f"the clocks of device and host differ by {clock.drift_ppm:.0f} ppm, more than {rules.max_drift_ppm:g}: "
            "the device overran, or its rate is not the rig's rate_hz"
        )
    return Verdict(clock, counts, share, not reasons, "; ".join(reasons))


def _runaway(clock: ClockFit, rules: Rules) -> bool:
    """No pair of clocks differs so much: something else is wrong, and times stay those of the device."""
    return abs(clock.drift_ppm) > rules.max_drift_ppm


def _device_times(table: Mapping[str, np.ndarray], rules: Rules) -> Array:
    """s by the device's clock: whole periods where its ticks say so, else the ticks, nominal where they are missing."""
    nominal = table["k"] / rules.rate_hz
    known = table["tick"] >= 0
    if not known.any():
        return nominal
    by_tick = np.array(table["tick"], dtype=float) * rules.tick_unit_s
    start = np.median((by_tick - nominal)[known])
    if np.abs(by_tick - nominal - start)[known].max() <= 1.01 * rules.tick_unit_s:
        return nominal
    return np.where(known, by_tick - start, nominal)


def _numbered(table: dict[str, np.ndarray], rules: Rules) -> dict[str, np.ndarray]:
    """Numbers by times of arrival; rows for the samples lost between."""
    k, _ = number_arrivals(table["host_s"], 1 / rules.rate_hz)
    N = int(k[-1]) + 1
    row_of = np.searchsorted(k, np.arange(N), side="right") - 1
    lost = k[row_of] != np.arange(N)
    full = {name: values[row_of].copy() for name, values in table.items()}
    for name in full:
        if name.startswith("y") or name == "host_s":
            full[name][lost] = np.nan
    for name in full:
        if name.startswith("u"):  # the force that the arrival before called for
            after = np.minimum(row_of + 1, len(k) - 1)
            full[name][lost] = table[name][after][lost]
    full["quality"] = np.where(lost, LOST, full["quality"])
    full["k"] = np.arange(N) + int(table["k"][0])
    return full


def rewrite(path: Path, out: Path, extra_origin: Mapping[str, Any]) -> tuple[Scan, Verdict | None]:
    """Write a clean file of all that is readable in `path`; samples of a rig get their times, flags and verdict.

    Raises InputError where nothing is readable. `out` may be `path`.
    """
    found = scan(path)
    origin = json.loads(found.attachments.pop(ORIGIN, b"{}")) | dict(extra_origin)
    table, verdict = None, None
    if len(found.columns.get("k", ())) >= 2 and "judged_by" in origin:
        rules = Rules(**origin["judged_by"])
        counts = origin.get("frames") or _counts(found.columns)
        table, verdict = judged(found.columns, rules, counts)
        origin |= verdict.as_origin()
    with atomic_write(out) as file:
        writer = Writer(file, chunk_size=1 << 20, compression=CompressionType.ZSTD, enable_data_crcs=True)
        writer.start(profile="", library="sysid_bench")
        describe(writer, found.properties, origin, found.attachments)
        _copy(path, writer, table)
        writer.finish()
    return found, verdict


def _counts(columns: Mapping[str, list[float]]) -> dict[str, int]:
    """Flagged samples by kind, where a killed host left no counts."""
    quality = np.array(columns["quality"], dtype=np.uint8)
    bits = {"lost": 1, "duplicated": 2, "reordered": 4, "corrupted": 8, "late": 16, "clipped": 32}
    return {name: int(np.count_nonzero(quality & bit)) for name, bit in bits.items()}


def _copy(path: Path, writer: Writer, table: Mapping[str, np.ndarray] | None) -> None:
    """All messages as they are, but those of a rig's record, which are written anew from `table`."""
    schemas: dict[int, Any] = {}
    channels: dict[int, tuple[int, Any]] = {}
    done = False
    for item in items(path):
        if isinstance(item, mcap_records.Schema):
            schemas[item.id] = item
        elif isinstance(item, mcap_records.Channel) and item.id not in channels:
            channels[item.id] = _channel(writer, item, schemas[item.schema_id], table is not None)
        elif isinstance(item, mcap_records.Message):
            number, anew = channels[item.channel_id]
            if anew is None or table is None:
                writer.add_message(number, item.log_time, item.data, item.publish_time, item.sequence)
            elif not done:
                _write_table(writer, number, anew, table)
                done = True


def _channel(writer: Writer, channel: Any, schema: Any, is_rig: bool) -> tuple[int, Any]:
    """(number in the new file, message class where its samples are written anew)."""
    message = class_from_schema(schema.name, schema.data)
    anew = message if is_rig and channel.topic == "/record" else None
    return register(writer, channel.topic, message), anew


def _write_table(writer: Writer, channel: int, message: Any, table: Mapping[str, np.ndarray]) -> None:
    """Log time: arrival; publish time: the device's sample on the host's clock."""
    known = np.flatnonzero(np.isfinite(table["host_s"]))
    start = float(np.min(table["host_s"][known] - table["t"][known])) if len(known) else 0.0
    names = list(table)
    whole = {"quality", "k", "tick"}
    for i in range(len(table["t"])):
        values = {n: int(table[n][i]) if n in whole else float(table[n][i]) for n in names}
        sampled = start + values["t"]
        arrived = values["host_s"] if np.isfinite(values["host_s"]) else sampled
        writer.add_message(
            channel,
            int(arrived * 1e9),
            message(**values).SerializeToString(),
            int(sampled * 1e9),
            sequence=values["k"] % 2**32,
        )
