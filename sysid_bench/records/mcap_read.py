"""MCAP -> Record: any protobuf topic with fields t, u1.., y1.., one sample or a batch per message."""

from __future__ import annotations

import json
import re
from array import array
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np
from google.protobuf.message import Message
from mcap import records as mcap_records

from sysid_bench.files.disk import sha256
from sysid_bench.nouns import InputError, Record
from sysid_bench.records.columns import MAX_VALUES, Place, record_from_columns
from sysid_bench.records.mcap_stream import DAMAGED, check_ends, stream
from sysid_bench.records.mcap_write import METADATA, ORIGIN, TOPIC
from sysid_bench.records.properties import properties_from
from sysid_bench.records.protobuf import class_from_schema

_COLUMN = re.compile(r"t|quality|[uy][1-9][0-9]{0,3}")


@dataclass
class _Topic:
    """Samples of one channel as they come in: a list of batches, or one growing array, per column."""

    message: type[Message]
    names: list[str]
    repeated: bool
    batches: dict[str, list[np.ndarray]] = field(default_factory=dict)
    singles: dict[str, array[float]] = field(default_factory=dict)
    values: int = 0

    def __post_init__(self) -> None:
        self.batches = {name: [] for name in self.names}
        self.singles = {name: array("d") for name in self.names}

    def add(self, data: bytes, place: Place) -> None:
        message = self.message.FromString(data)
        if self.repeated:
            batch = {name: np.array(getattr(message, name), dtype=np.float64) for name in self.names}
            _check_batch(batch, place)
            for name, values in batch.items():
                self.batches[name].append(values)
            self.values += len(batch["t"]) * len(batch)
        else:
            for name, values in self.singles.items():
                values.append(getattr(message, name))
            self.values += len(self.names)
        if self.values > MAX_VALUES:
            raise place.refuse(f"more than {MAX_VALUES:,} values; split the record.")

    def columns(self) -> dict[str, np.ndarray]:
        if self.repeated:
            return {name: np.concatenate(parts or [np.empty(0)]) for name, parts in self.batches.items()}
        return {name: np.array(values) for name, values in self.singles.items()}


def _check_batch(batch: dict[str, np.ndarray], place: Place) -> None:
    for name, values in batch.items():
        if len(values) != len(batch["t"]):
            raise place.refuse(
                f"a batch has {len(batch['t'])} times but {len(values)} values of column {name}; one of each "
                "per sample is wanted."
            )


def read(path: Path, topic: str | None = None) -> Record:
    """Record of an MCAP file, read as a stream. Raises InputError; a truncated file names `recover`.

    topic  the topic to read; None: `/record`, or the only topic with fields t, u1.., y1..
    """
    place = Place(str(path), lambda k: f"sample {k}")
    check_ends(path)
    try:
        with open(path, "rb") as file:
            topics, properties = _collect(file, path.stat().st_size, place)
    except InputError:
        raise
    except DAMAGED as problem:
        raise place.refuse(
            f"damaged MCAP ({type(problem).__name__}: {str(problem)[:120]}). "
            f"`sysid-bench recover {path}` writes what is still readable."
        ) from None
    columns = _chosen(topics, topic, place).columns()
    origin = {"source": f"file {path.name}", **properties.pop("origin")}
    origin["file"] = {"path": str(path), "sha256": sha256(path)}
    return record_from_columns(columns, place, even=False, origin=origin, **properties)


def read_attachments(path: Path) -> dict[str, bytes]:
    """Attachments of an MCAP file by name. Raises InputError where it is damaged."""
    check_ends(path)
    try:
        with open(path, "rb") as file:
            found = stream(file, path.stat().st_size)
            return {item.name: item.data for item in found if isinstance(item, mcap_records.Attachment)}
    except DAMAGED as problem:
        raise InputError(f"record {path}: damaged MCAP ({type(problem).__name__}).") from None


def _collect(file: IO[bytes], size: int, place: Place) -> tuple[dict[str, _Topic], dict[str, Any]]:
    """(samples by topic, keywords of Record) of the whole stream."""
    schemas: dict[int, Any] = {}
    channels: dict[int, _Topic | None] = {}
    topics: dict[str, _Topic] = {}
    stored: dict[str, Any] = {}
    for item in stream(file, size):
        if isinstance(item, mcap_records.Message):
            if (channel := channels[item.channel_id]) is not None:
                channel.add(item.data, place)
        elif isinstance(item, mcap_records.Schema):
            schemas[item.id] = item
        elif isinstance(item, mcap_records.Channel):
            if item.id not in channels:
                channels[item.id] = found = _topic(item, schemas.get(item.schema_id))
                if found is not None:
                    topics[item.topic] = found
        elif isinstance(item, mcap_records.Metadata) and item.name == METADATA:
            stored |= {key: json.loads(value) for key, value in item.metadata.items()}
        elif isinstance(item, mcap_records.Attachment) and item.name == ORIGIN:
            stored["origin"] = json.loads(item.data)
    return topics, properties_from(stored, place)


def _topic(channel: Any, schema: Any) -> _Topic | None:
    """A channel with columns of a record, else None."""
    if channel.message_encoding != "protobuf" or schema is None or schema.encoding != "protobuf":
        return None
    message = class_from_schema(schema.name, schema.data)
    numbers = [
        f for f in message.DESCRIPTOR.fields if f.message_type is None and f.cpp_type <= f.CPPTYPE_BOOL
    ]
    names = [f.name for f in numbers if _COLUMN.fullmatch(f.name)]
    if not {"t", "y1"} <= set(names):
        return None
    kinds = {hasattr(getattr(message(), name), "__len__") for name in names}
    return _Topic(message, names, repeated=kinds.pop()) if len(kinds) == 1 else None


def _chosen(topics: dict[str, _Topic], topic: str | None, place: Place) -> _Topic:
    found = ", ".join(sorted(topics)) or "none"
    if topic is not None and topic not in topics:
        raise place.refuse(f"topic {topic!r} has no samples; topics with fields t, u1.., y1..: {found}.")
    if topic is None and TOPIC in topics:
        topic = TOPIC
    if topic is None and len(topics) == 1:
        topic = next(iter(topics))
    if topic is None:
        raise place.refuse(
            f"wanted topic {TOPIC} with protobuf fields t, u1.., y1..; topics with such fields: {found}."
        )
    return topics[topic]
