"""Record files: seconds to write and read 100 000 samples of 8 channels, as ratios to the batched MCAP; medians.

python benchmarks/record_files.py [samples]
"""

from __future__ import annotations

import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.writer import Writer

from sysid_bench.nouns import Record
from sysid_bench.records import read_record, write_record
from sysid_bench.records.columns import column_names
from sysid_bench.records.mcap_write import describe, log_times, register, sample_class

RUNS = 3


def record_of(samples: int) -> Record:
    rng = np.random.default_rng(0)
    return Record(
        np.arange(samples) * 1e-3, rng.normal(size=(samples, 4)), rng.normal(size=(samples, 4)), hold="zoh"
    )


def write_per_sample(record: Record, path: Path) -> None:
    """One protobuf message per sample, as a rig writes."""
    names = column_names(record, quality=False)
    message = sample_class(names)
    with open(path, "wb") as file:
        writer = Writer(file, chunk_size=64 * 1024)
        writer.start()
        describe(writer, {"hold": record.hold}, {})
        channel = register(writer, "/record", message)
        rows = np.column_stack([record.t, record.u, record.y]).tolist()
        for row, stamp in zip(rows, log_times(record.t, 0.0), strict=True):
            data = message(**dict(zip(names, row, strict=True))).SerializeToString()
            writer.add_message(channel, stamp, data, stamp)
        writer.finish()


def write_json(record: Record, path: Path) -> None:
    """One JSON object per sample: what the suite does not do, for comparison (written only)."""
    names = column_names(record, quality=False)
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel(
            "/record", "json", writer.register_schema("Sample", "jsonschema", b"{}")
        )
        rows = np.column_stack([record.t, record.u, record.y]).tolist()
        for row, stamp in zip(rows, log_times(record.t, 0.0), strict=True):
            writer.add_message(channel, stamp, json.dumps(dict(zip(names, row, strict=True))).encode(), stamp)
        writer.finish()


def median_s(action: Callable[[], object]) -> float:
    seconds = []
    for _ in range(RUNS):
        start = time.perf_counter()
        action()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)


def main(samples: int) -> None:
    record = record_of(samples)
    raw = record.t.nbytes + record.u.nbytes + record.y.nbytes
    writers: dict[str, tuple[str, Callable[[Record, Path], None]]] = {
        "mcap, batches of 1000": ("a.mcap", write_record),
        "mcap, a message per sample": ("b.mcap", write_per_sample),
        "mcap, JSON per sample": ("c.mcap", write_json),
        "csv": ("d.csv", write_record),
        "parquet": ("e.parquet", write_record),
    }
    print(
        f"{samples} samples, 4 inputs, 4 outputs, {raw / 1e6:.1f} MB of float64; median of {RUNS}; x: against the first line"
    )
    first: tuple[float, float] | None = None
    with tempfile.TemporaryDirectory() as folder:
        for name, (file, write) in writers.items():
            path = Path(folder) / file
            writing = median_s(lambda write=write, path=path: write(record, path))
            reading = None if "JSON" in name else median_s(lambda path=path: read_record(path))
            first = first or (writing, reading or 0.0)
            shown = "" if reading is None else f"read {reading:7.3f} s ({reading / first[1]:5.1f} x)"
            size = path.stat().st_size / raw
            print(
                f"{name:28} write {writing:7.3f} s ({writing / first[0]:5.1f} x)   {shown:26}   {size:4.2f} of raw"
            )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000)
