"""a log as it was written, whole or cut off -> a clean record file: sample times on the host's clock, flags, verdict."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap import records as mcap_records
from mcap.writer import CompressionType, Writer

from sysid_bench.files.disk import atomic_write
from sysid_bench.measure.judge import Rules, Verdict, judged
from sysid_bench.nouns import InputError
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

    def add(self, sample: Any) -> None:
        """Take one sample message of the record."""
        for descriptor in sample.DESCRIPTOR.fields:
            self.columns.setdefault(descriptor.name, []).append(getattr(sample, descriptor.name))


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
                found.add(message.FromString(item.data))
    if not channels:
        raise InputError(f"{path}: nothing to recover; it ends before its first sample.")
    return found


def rewrite(
    path: Path, out: Path, extra_origin: Mapping[str, Any], known: Scan | None = None
) -> tuple[Scan, Verdict | None]:
    """Write a clean file of all that is readable in `path`; samples of a rig get their times, flags and verdict.

    `known` spares a first reading where the writer still knows what it wrote. `out` may be `path`.
    Raises InputError where nothing is readable.
    """
    found = known or scan(path)
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
