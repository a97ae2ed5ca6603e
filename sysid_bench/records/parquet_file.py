"""Parquet <-> Record: the CSV's columns; hold, period, units and origin as JSON in the schema's metadata."""

# protobuf, mcap and pyarrow say no types.
# pyright: reportMissingTypeStubs=false, reportUnknownArgumentType=false, reportUnknownMemberType=false, reportUnknownParameterType=false, reportUnknownVariableType=false

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from sysid_bench.files.disk import atomic_write, plain, sha256
from sysid_bench.nouns import InputError, Record
from sysid_bench.records.columns import Place, channels, check_size, columns_of, record_from_columns
from sysid_bench.records.properties import properties_from, properties_of

KEY = b"sysid_bench.record"
_READING = {
    "page_checksum_verification": True,
    "thrift_string_size_limit": 64 * 2**20,
    "thrift_container_size_limit": 2**20,
}


def read(path: Path) -> Record:
    """Record of a Parquet file. Raises InputError as the CSV reader does."""
    place = Place(str(path), lambda k: f"row {k}")
    try:
        with pq.ParquetFile(path, **_READING) as file:
            columns, stored = (
                _columns(file, place, path.stat().st_size),
                (file.schema_arrow.metadata or {}).get(KEY, b"{}"),
            )
    except (pa.ArrowException, OSError, ValueError, MemoryError) as problem:
        if isinstance(problem, InputError):
            raise
        raise place.refuse(
            f"not a Parquet file that can be read ({str(problem).splitlines()[0][:160]})."
        ) from None
    properties = properties_from(_json(stored, place), place)
    origin = {"source": f"file {path.name}", **properties.pop("origin", {})}
    origin["file"] = {"path": str(path), "sha256": sha256(path)}
    return record_from_columns(columns, place, even=True, origin=origin, **properties)


def write(record: Record, path: Path) -> None:
    """Write a record with all its properties, zstd-compressed."""
    table = pa.table({name: np.asarray(values) for name, values in columns_of(record).items()})
    properties = json.dumps(plain({**properties_of(record), "origin": record.origin}), allow_nan=False)
    with atomic_write(path) as file:
        pq.write_table(
            table.replace_schema_metadata({KEY: properties.encode()}),
            file,
            compression="zstd",
            write_page_checksum=True,
        )


def _columns(file: pq.ParquetFile, place: Place, file_bytes: int) -> dict[str, np.ndarray]:
    names = file.schema_arrow.names
    channels(names, place)
    check_size(file.metadata.num_rows, len(names), place, file_bytes)
    for field in file.schema_arrow:
        if not (pa.types.is_floating(field.type) or pa.types.is_integer(field.type)):
            raise place.refuse(f"numbers are wanted; got {field.type}.", column=field.name)
    table = file.read()
    for name in names:
        if table[name].null_count:
            k = int(np.argmax(table[name].is_null().to_numpy()))
            raise place.refuse("a number is wanted; got nothing (null).", k, name)
    return {name: table[name].to_numpy().astype(np.float64, copy=False) for name in names}


def _json(stored: bytes, place: Place) -> dict[str, Any]:
    try:
        value = json.loads(stored)
    except (ValueError, RecursionError):
        value = None
    if not isinstance(value, dict):
        raise place.refuse(f"its metadata {KEY.decode()} is not a JSON object.")
    return value
