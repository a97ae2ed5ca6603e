"""Record files by suffix: .mcap (native), .csv, .parquet."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sysid_bench.files.disk import existing_file
from sysid_bench.nouns import InputError, Record

SUFFIXES = (".mcap", ".csv", ".parquet")


def read_record(path: str | os.PathLike[str], **options: Any) -> Record:
    """Record of a file. Raises InputError: absent, empty, wrong suffix, damaged, not a record of ours.

    `options`: topic="/name" for MCAP files with several topics.
    """
    suffix = _suffix(path)
    path = existing_file(path, "record")
    if options and suffix != ".mcap":
        raise InputError(f"record {path}: {', '.join(options)} is for .mcap files only.")
    if suffix == ".mcap":
        from . import mcap_read

        return mcap_read.read(path, **options)
    if suffix == ".csv":
        from . import csv_file

        return csv_file.read(path)
    from . import parquet_file

    return parquet_file.read(path)


def write_record(
    record: Record, path: str | os.PathLike[str], attachments: Mapping[str, bytes | str] | None = None
) -> None:
    """Write a record, whole or not at all. Raises InputError on a wrong suffix or where it cannot be written.

    `attachments` (files by name, e.g. {"config.yaml": text}) are kept by .mcap only.
    """
    suffix, path = _suffix(path), Path(path)
    if record.nu < 1 or record.ny < 1:
        raise InputError(
            f"record files need at least one input and one output; got nu={record.nu}, ny={record.ny}."
        )
    if suffix == ".mcap":
        from . import mcap_write

        mcap_write.write(record, path, attachments)
    elif suffix == ".csv":
        from . import csv_file

        csv_file.write(record, path)
    else:
        from . import parquet_file

        parquet_file.write(record, path)


def record_path(path: str | os.PathLike[str]) -> Path:
    """`path` as a Path. Raises InputError where its suffix is none of a record file's."""
    _suffix(path)
    return Path(path)


def _suffix(path: str | os.PathLike[str]) -> str:
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(
            f"record {os.fspath(path)}: its name must end in {', '.join(SUFFIXES)}; got {suffix or 'no suffix'!r}."
        )
    return suffix
