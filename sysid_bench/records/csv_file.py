"""CSV <-> Record: header t,u1..,y1..[,quality]; seconds, SI; values in the shortest form that reads back exactly."""

# protobuf, mcap and pyarrow say no types.
# pyright: reportMissingTypeStubs=false, reportUnknownArgumentType=false, reportUnknownMemberType=false, reportUnknownVariableType=false

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv

from sysid_bench.files.disk import atomic_write, sha256
from sysid_bench.nouns import InputError, Record
from sysid_bench.records.columns import MAX_VALUES, WANTED, Place, channels, columns_of, record_from_columns

MAX_HEADER_BYTES = 64 * 1024
MAX_LINE_BYTES = 1024 * 1024
_NUMBER = re.compile(
    r"\s*[+-]?(\d+\.?\d*([eE][+-]?\d+)?|\.\d+([eE][+-]?\d+)?|nan|inf|infinity)\s*", re.IGNORECASE
)


def read(path: Path) -> Record:
    """Record of a CSV; its hold and units are unknown, which the file cannot say."""
    names = _header(path)
    channels(names, Place(str(path), lambda k: ""))
    columns = _columns(path, names)
    origin = {"source": f"file {path.name}", "file": {"path": str(path), "sha256": sha256(path)}}
    return record_from_columns(columns, Place(str(path), partial(_line_of, path)), even=True, origin=origin)


def write(record: Record, path: Path) -> None:
    """Write t, u, y and quality; hold, units, period and origin have no place in a CSV."""
    columns = columns_of(record)
    options = pacsv.WriteOptions(include_header=False, batch_size=65536)
    with atomic_write(path) as file:
        file.write(",".join(columns).encode() + b"\n")
        pacsv.write_csv(
            pa.table({name: np.asarray(values) for name, values in columns.items()}), file, options
        )


def _header(path: Path) -> list[str]:
    """Names in the first line. Raises InputError where it is no header of ours, with the likely reason."""
    with open(path, "rb") as file:
        line = file.readline(MAX_HEADER_BYTES)
    if len(line) == MAX_HEADER_BYTES:
        raise InputError(
            f"record {path}, line 1: longer than {MAX_HEADER_BYTES:,} bytes; wanted a header with {WANTED}."
        )
    try:
        text = line.decode("utf-8-sig").strip()
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise InputError(f"record {path}, line 1: not text; wanted a CSV file whose header has {WANTED}.")
    names = [name.strip().strip('"') for name in text.split(",")]
    for separator, word in ((";", "semicolons"), ("\t", "tabs")):
        if len(names) == 1 and separator in text:
            raise InputError(f"record {path}, line 1: columns are separated by {word}; commas are wanted.")
    if all(_NUMBER.fullmatch(name) for name in names):
        raise InputError(f"record {path}, line 1: numbers where the header was wanted ({WANTED}).")
    return names


def _columns(path: Path, names: list[str]) -> dict[str, np.ndarray]:
    if path.stat().st_size > 8 * MAX_VALUES:
        raise InputError(
            f"record {path}: {path.stat().st_size:,} bytes are too many to read at once; split it."
        )
    try:
        table = pacsv.read_csv(
            path,
            pacsv.ReadOptions(column_names=names, skip_rows=1, block_size=MAX_LINE_BYTES),
            pacsv.ParseOptions(newlines_in_values=False),
            pacsv.ConvertOptions(column_types=dict.fromkeys(names, pa.float64()), null_values=[]),
        )
    except (pa.ArrowException, OSError, ValueError) as problem:
        raise _explained(path, names, str(problem)) from None
    return {name: table[name].to_numpy() for name in names}


def _explained(path: Path, names: list[str], fallback: str) -> InputError:
    """What is wrong with a CSV that could not be read: the first bad line and column."""
    lines = _lines(path)
    next(lines, None)
    for number, line in lines:
        if len(line) >= MAX_LINE_BYTES:
            return InputError(f"record {path}, line {number}: longer than {MAX_LINE_BYTES:,} characters.")
        cells = [cell.strip().strip('"') for cell in line.split(",")]
        if len(cells) != len(names):
            return InputError(
                f"record {path}, line {number}: {len(names)} values are wanted ({', '.join(names[:8])}"
                f"{', ...' if len(names) > 8 else ''}); got {len(cells)}."
            )
        for name, cell in zip(names, cells, strict=True):
            if not _NUMBER.fullmatch(cell):
                return InputError(
                    f"record {path}, line {number}, column {name}: a number is wanted; got {cell[:40]!r}. "
                    "Where a sample was lost, write nan and flag it in a quality column."
                )
    return InputError(
        f"record {path}: not a CSV that can be read ({fallback.splitlines()[0][:200] if fallback else ''})."
    )


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Numbered lines that are not blank."""
    number = 0
    with open(path, encoding="utf-8-sig", errors="replace", newline=None) as file:
        while line := file.readline(MAX_LINE_BYTES):
            number += 1
            if line.strip("\r\n"):
                yield number, line


def _line_of(path: Path, sample: int) -> str:
    """The line of a sample, counted as an editor does (blank lines included)."""
    for row, (number, _) in enumerate(_lines(path)):
        if row == sample + 1:
            return f"line {number}"
    return f"sample {sample}"
