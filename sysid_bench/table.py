"""rows -> table.parquet (tidy, one row per cell) and summary.csv (medians, quantiles, rms, failures, runs)."""

from __future__ import annotations

import csv
import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

BATCH = 5000
ERRORS = ("M_error", "D_error", "K_error", "A_error", "pole_error")
RATIOS = ("M_over_bound", "D_over_bound", "K_over_bound", "A_over_bound", "pole_over_bound")
LABELS = ("plant", "excitation", "noise", "source", "method", "analysis")


def write_table(rows: Iterable[Mapping[str, Any]], path: Path) -> int:
    """Stream rows into a Parquet file whose columns are the union of theirs; returns their number.

    `rows` is iterated twice (pass a list or an object that can be iterated anew). Written to a temporary
    file, then renamed.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = pa.schema([(name, kind) for name, kind in _columns(rows).items()])
    part = path.with_name(path.name + ".part")
    count = 0
    with pq.ParquetWriter(part, schema, compression="zstd") as writer:
        for batch in _batches(rows):
            columns = {
                f.name: pa.array([_fit(row.get(f.name), f.type) for row in batch], f.type) for f in schema
            }
            writer.write_table(pa.table(columns, schema=schema))
            count += len(batch)
    part.replace(path)
    return count


def _columns(rows: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    import pyarrow as pa

    seen: dict[str, set[type]] = {}
    for row in rows:
        for name, value in row.items():
            kinds = seen.setdefault(name, set())
            if value is not None:
                kinds.add(str if isinstance(value, int) and value.bit_length() > 63 else type(value))
    types = {frozenset({bool}): pa.bool_(), frozenset({int}): pa.int64()}
    numbers = {float, int, bool}
    return {
        name: types.get(frozenset(kinds), pa.float64() if kinds <= numbers else pa.string())
        for name, kinds in seen.items()
    }


def _fit(value: Any, kind: Any) -> Any:
    if value is None:
        return None
    if str(kind) == "string":
        return str(value)
    return float(value) if str(kind) == "double" else value


def _batches(rows: Iterable[Mapping[str, Any]]) -> Iterator[list[Mapping[str, Any]]]:
    iterator = iter(rows)
    while batch := list(itertools.islice(iterator, BATCH)):
        yield batch


def read_table(path: Path, columns: Sequence[str] | None = None) -> dict[str, np.ndarray]:
    """Columns of a table by name: numbers as float64 (missing: NaN), words as object arrays, flags as bool.

    columns: those wanted (of these, those that there are); None: all.
    """
    import pyarrow.parquet as pq

    with pq.ParquetFile(path) as file:
        there = file.schema_arrow.names
        return _as_arrays(file.read([name for name in there if columns is None or name in columns]))


def _as_arrays(table: Any) -> dict[str, np.ndarray]:
    columns = {}
    for name in table.column_names:
        column = table[name]
        kind = str(column.type)
        if kind in ("double", "int64"):
            keep = kind == "int64" and column.null_count == 0
            columns[name] = column.to_numpy() if keep else column.cast("float64", safe=False).to_numpy()
        elif kind == "string":
            columns[name] = _words(column)
        else:
            columns[name] = np.array(column.to_pylist(), dtype=object)
    return columns


def _words(column: Any) -> np.ndarray:
    """Equal words of a column are one object: a table has few words, often."""
    codes = column.combine_chunks().dictionary_encode()
    words = np.array([*codes.dictionary.to_pylist(), None], dtype=object)
    return words[codes.indices.fill_null(len(words) - 1).to_numpy()]


def groups_of(table: Mapping[str, np.ndarray], by: Sequence[str]) -> list[tuple[dict[str, Any], np.ndarray]]:
    """(label values, row indices) per distinct combination of the columns `by`, in order of appearance.

    A number that is missing (NaN: a knob that the row's option does not have) is the value None.
    """
    found: dict[tuple[Any, ...], list[int]] = {}
    for k, values in enumerate(zip(*(table[name] for name in by))):
        found.setdefault(tuple(_label(v) for v in values), []).append(k)
    return [(dict(zip(by, values)), np.array(rows)) for values, rows in found.items()]


def _label(value: Any) -> Any:
    value = value.item() if isinstance(value, np.generic) else value
    return None if value != value else value  # NaN is unequal to itself, and would make a group of every row


def summary_columns(axes: Iterable[str]) -> list[str]:
    """What `summary` asks of a table."""
    return [*LABELS, *axes, "sampling.h_s", "sampling.N", "status", "fit_s", *ERRORS, *RATIOS]


def axes_of(table: Mapping[str, np.ndarray], axes: Iterable[str]) -> list[str]:
    """The label columns that tell points of a study apart: option names and swept knobs, not repetitions."""
    wanted = [*LABELS, *axes, "sampling.h_s", "sampling.N"]
    return [name for name in dict.fromkeys(wanted) if name in table]


def summary(table: Mapping[str, np.ndarray], axes: Iterable[str]) -> list[dict[str, Any]]:
    """One row per point and method: runs, failures by status, and of each error the median, the 10 % and 90 %
    quantiles (over the runs that are ok), the rms of its ratio to the Cramer-Rao bound, the median seconds."""
    return [labels | _statistics(table, rows) for labels, rows in groups_of(table, axes_of(table, axes))]


def _statistics(table: Mapping[str, np.ndarray], rows: np.ndarray) -> dict[str, Any]:
    ok = rows[table["status"][rows] == "ok"]
    failures = Counter(table["status"][rows])
    failures.pop("ok", None)
    found: dict[str, Any] = {"runs": len(rows), "ok": len(ok)}
    found["failures"] = " ".join(f"{status}:{count}" for status, count in sorted(failures.items()))
    for name in ERRORS:
        if name in table:
            values = _finite(table[name][ok])
            for word, q in (("median", 0.5), ("q10", 0.1), ("q90", 0.9)):
                found[f"{name}_{word}"] = float(np.quantile(values, q)) if len(values) else None
    for name in RATIOS:
        if name in table:
            values = _finite(table[name][ok])
            found[f"{name}_rms"] = float(np.sqrt(np.mean(values**2))) if len(values) else None
    if "fit_s" in table:
        values = _finite(table["fit_s"][ok])
        found["fit_s_median"] = float(np.median(values)) if len(values) else None
    return found


def _finite(values: np.ndarray) -> np.ndarray:
    values = values.astype(float)
    return values[np.isfinite(values)]


def write_csv(rows: Sequence[Mapping[str, Any]], path: Path, digits: int = 6) -> None:
    """Rows as CSV for people and for git diffs: numbers to `digits` significant digits, missing left empty."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    part = path.with_name(path.name + ".part")
    with part.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        for row in rows:
            writer.writerow([_text(row.get(name), digits) for name in names])
    part.replace(path)


def _text(value: Any, digits: int) -> str:
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return ""
    return f"{value:.{digits}g}" if isinstance(value, float) else str(value)
