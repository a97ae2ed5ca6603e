"""Record -> MCAP: metadata and attachments first, then batches of samples as protobuf.

Every record file has topic `/record`; its messages are `sysid_bench.Samples` (a batch: each column a
repeated double) where a simulation writes, `sysid_bench.Sample` (one sample: each column a double) where a
rig writes as it goes. Columns are those of the CSV; messages may hold further fields.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.message import Message
from mcap.writer import Writer

from sysid_bench.files.disk import atomic_write, json_text, plain
from sysid_bench.nouns import Record
from sysid_bench.records.columns import columns_of
from sysid_bench.records.properties import properties_of
from sysid_bench.records.protobuf import message_class, schema_data

TOPIC = "/record"
METADATA = "sysid_bench.record"
ORIGIN = "origin.json"
FORMAT = "1"
BATCH = 1000


def sample_class(names: Sequence[str], extra: Mapping[str, str] | None = None) -> type[Message]:
    """Message of one sample with the columns `names` (records.columns.column_names) and extra fields."""
    kinds = {name: "uint32" if name == "quality" else "double" for name in names}
    return message_class("sysid_bench.Sample", {**kinds, **(extra or {})})


def batch_class(names: Sequence[str]) -> type[Message]:
    """Message of a batch of samples with the columns `names`."""
    kinds = {name: "repeated uint32" if name == "quality" else "repeated double" for name in names}
    return message_class("sysid_bench.Samples", kinds)


def register(writer: Writer, topic: str, message: type[Message]) -> int:
    """Register a protobuf channel; returns its number."""
    schema = writer.register_schema(message.DESCRIPTOR.full_name, "protobuf", schema_data(message))
    return writer.register_channel(topic, "protobuf", schema)


def describe(
    writer: Writer,
    properties: Mapping[str, Any],
    origin: Mapping[str, Any],
    attachments: Mapping[str, bytes | str] | None = None,
) -> None:
    """Write what a reader must know before the first sample, so that a killed writer leaves it.

    properties   {"hold": .., "period": .., "units": {..}}
    origin       what made the record (resolved config, seed, versions, ...)
    attachments  further files by name, e.g. {"rig.dbc": ...}
    """
    values = {key: json.dumps(plain(value)) for key, value in properties.items()}
    writer.add_metadata(METADATA, {"format": FORMAT, **values})
    for name, data in {ORIGIN: json_text(origin), **(attachments or {})}.items():
        data = data.encode() if isinstance(data, str) else data
        kind = "application/json" if name.endswith(".json") else "application/octet-stream"
        writer.add_attachment(create_time=0, log_time=0, name=name, media_type=kind, data=data)


def write(record: Record, path: Path, attachments: Mapping[str, bytes | str] | None = None) -> None:
    """Write a record, bit-exact, in batches of 1000 samples, zstd-compressed, with checksums."""
    columns = columns_of(record)
    message = batch_class(list(columns))
    with atomic_write(path) as file:
        writer = Writer(file, enable_data_crcs=True)
        writer.start(profile="", library="sysid_bench")
        describe(writer, properties_of(record), record.origin, attachments)
        channel = register(writer, TOPIC, message)
        times = log_times(record.t[::BATCH], record.t[0])
        for number, start in enumerate(range(0, record.N, BATCH)):
            batch = {name: values[start : start + BATCH].tolist() for name, values in columns.items()}
            data, time = message(**batch).SerializeToString(), times[number]
            writer.add_message(channel, time, data, time, sequence=number)
        writer.finish()


def log_times(t: np.ndarray, first: float) -> list[int]:
    """Times in s as MCAP's unsigned nanoseconds; a record that starts before 0 is shifted to start at 0."""
    return [int(x) for x in np.clip(np.round((t - min(first, 0.0)) * 1e9), 0, 2.0**62)]
