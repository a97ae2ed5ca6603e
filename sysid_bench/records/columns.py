"""named columns t, u1.., y1.., quality <-> Record: the checks that all record files share."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid_bench.nouns import UNIFORM_STEP_RTOL, Array, InputError, Record

MAX_COLUMNS = 1024
MAX_VALUES = 500_000_000  # 4 GB of float64: what one record may take in memory
MAX_PER_BYTE = 50  # values per byte of a compressed file: times alone take more; beyond is a bomb
WANTED = "columns t, u1..u<nu>, y1..y<ny> and optionally quality"


@dataclass(frozen=True)
class Place:
    """Where a record's samples stand: names a position for a message."""

    path: str
    position: Callable[[int], str]  # number of a sample -> "line 12"

    def refuse(self, message: str, sample: int | None = None, column: str | None = None) -> InputError:
        parts = [f"record {self.path}"]
        if sample is not None:
            parts.append(self.position(sample))
        if column is not None:
            parts.append(f"column {column}")
        return InputError(", ".join(parts) + ": " + message)


def column_names(record: Record, quality: bool) -> list[str]:
    """Names of a record's columns in the order of the files."""
    u = [f"u{i + 1}" for i in range(record.nu)]
    y = [f"y{i + 1}" for i in range(record.ny)]
    return ["t", *u, *y, *(["quality"] if quality else [])]


def columns_of(record: Record) -> dict[str, np.ndarray]:
    """Columns of a record by name; quality is written where it is known or where steps are uneven."""
    quality = record.quality is not None or not record.is_uniform
    flags = np.zeros(record.N, np.uint8) if record.quality is None else record.quality
    columns = [record.t, *record.u.T, *record.y.T, *([flags] if quality else [])]
    return dict(zip(column_names(record, quality), columns, strict=True))


def channels(names: Sequence[str], place: Place) -> tuple[int, int]:
    """(nu, ny) of column names in any order. Raises InputError: missing, repeated, unknown, too many."""
    if len(names) > MAX_COLUMNS:
        raise place.refuse(f"{len(names)} columns; at most {MAX_COLUMNS} are read.")
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise place.refuse(f"column {_shown(repeated[0])} stands there more than once.")
    unknown = [name for name in names if not re.fullmatch(r"t|quality|[uy][1-9][0-9]{0,3}", name)]
    if unknown:
        raise place.refuse(
            f"column {_shown(unknown[0])} is not known; wanted {WANTED}. Rename or remove it "
            f"(found: {', '.join(map(_shown, names[:12]))}{', ...' if len(names) > 12 else ''})."
        )
    counts = {letter: sum(name[0] == letter and name[1:].isdigit() for name in names) for letter in "uy"}
    wanted = ["t", *(f"{letter}{i + 1}" for letter in "uy" for i in range(max(counts[letter], 1)))]
    missing = [name for name in wanted if name not in names]
    if missing:
        raise place.refuse(
            f"column {missing[0]} is missing; wanted {WANTED} (found: {', '.join(names[:12])})."
        )
    return counts["u"], counts["y"]


def _shown(name: str) -> str:
    return repr(name if len(name) <= 40 else name[:40] + "...")


def check_size(samples: int, columns: int, place: Place, file_bytes: int | None = None) -> None:
    """Raises InputError where a record is empty, would not fit, or is more than its file can honestly hold."""
    if samples < 2:
        raise place.refuse(f"at least 2 samples are wanted; it has {samples}.")
    if samples * columns > MAX_VALUES:
        raise place.refuse(
            f"{samples:,} samples of {columns} columns are more than the {MAX_VALUES:,} values that are read "
            "at once; split the record."
        )
    if file_bytes is not None and samples * columns > MAX_PER_BYTE * file_bytes:
        raise place.refuse(
            f"{samples:,} samples of {columns} columns in {file_bytes:,} bytes cannot be a measured record."
        )


def record_from_columns(
    columns: Mapping[str, np.ndarray], place: Place, *, even: bool, **properties: Any
) -> Record:
    """Record of named columns. Raises InputError with file, place, column, what was wanted, the way out.

    even        demand a constant step where there is no quality column
    properties  hold, period, units, origin of the record
    """
    nu, ny = channels(list(columns), place)
    check_size(len(columns["t"]), len(columns), place)
    quality = _quality(columns["quality"], place) if "quality" in columns else None
    _check_times(columns["t"], place, even and quality is None)
    names = [f"{letter}{i + 1}" for letter, count in (("u", nu), ("y", ny)) for i in range(count)]
    for name in names:
        _check_finite(columns[name], name, quality, place)
    u = np.column_stack([columns[name] for name in names[:nu]])
    y = np.column_stack([columns[name] for name in names[nu:]])
    return Record(columns["t"], u, y, quality=quality, **properties)


def _quality(values: np.ndarray, place: Place) -> np.ndarray:
    values = np.asarray(values, dtype=np.float64)
    bad = ~((values >= 0) & (values <= 255) & (values == np.floor(values)))
    if bad.any():
        k = int(np.argmax(bad))
        raise place.refuse(f"an integer 0..255 is wanted (0 = good); got {values[k]:g}.", k, "quality")
    return values.astype(np.uint8)


def _check_times(t: Array, place: Place, even: bool) -> None:
    bad = ~np.isfinite(t)
    if bad.any():
        k = int(np.argmax(bad))
        raise place.refuse(f"a finite time in s is wanted; got {t[k]}. Remove the sample.", k, "t")
    steps = np.diff(t)
    if (steps <= 0).any():
        k = int(np.argmax(steps <= 0))
        kind = "the same time twice" if steps[k] == 0 else "a time before its predecessor"
        raise place.refuse(
            f"times must increase; got {kind} ({t[k + 1]} after {t[k]}). "
            "Sort the samples by time and remove repeated ones.",
            k + 1,
            "t",
        )
    step = steps.mean()
    if even and (np.abs(steps - step) > UNIFORM_STEP_RTOL * step).any():
        usual = float(np.median(steps))
        k = int(np.argmax(np.abs(steps - usual)))
        digits = "Subtract the first time: numbers as large as these keep too few digits of the step"
        rounded = np.spacing(np.abs(t).max()) > 0.1 * UNIFORM_STEP_RTOL * step
        raise place.refuse(
            f"a constant step is wanted (to {UNIFORM_STEP_RTOL:g} relative); this one is {steps[k]:.9g} s, the "
            f"median {usual:.9g} s. {digits if rounded else 'Write times with enough digits'}, resample, or, for "
            "samples with gaps, add a quality column (0 = good).",
            k + 1,
            "t",
        )


def _check_finite(values: Array, name: str, quality: np.ndarray | None, place: Place) -> None:
    bad = ~np.isfinite(values)
    if quality is not None:
        bad &= quality == 0
    if bad.any():
        k = int(np.argmax(bad))
        raise place.refuse(
            f"a finite number is wanted; got {values[k]}. Remove the sample, or flag it in a quality column "
            "(0 = good, 1 = lost).",
            k,
            name,
        )
