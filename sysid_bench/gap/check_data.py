"""records -> what is wrong with the data themselves: named before any physics is suspected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sysid_bench.nouns import Array, InputError, Model, Record

NOTICEABLE_STEP = 0.02  # of the signal's rms: below, quantisation is only part of the noise floor
FEWEST_CLIPPED = 6
LARGEST = 1e100
MOST = 1_000_000  # samples times degrees of freedom: 3 GB for one degree of freedom and no effect
AT_REST = 0.05  # of the rms step between samples: a sensor that sticks lets go with a jump


@dataclass(frozen=True)
class Fault:
    """One fault of the data: name of the effect, output channel, parameters by name, what was seen."""

    name: str
    channel: int | None
    parameters: Mapping[str, float]
    evidence: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class DataCheck:
    """faults, remarks for the report, lattice (ny,) step of each channel's values (0: none), bad (N,) per record.

    drives: inputs that were clipped as recorded; no prediction from them is wrong, so they are no effect that is missing
    """

    faults: list[Fault]
    remarks: list[str]
    lattice: Array
    bad: list[np.ndarray] = field(default_factory=list)
    drives: list[Fault] = field(default_factory=list)


def check_data(records: list[Record]) -> DataCheck:
    """Time stamps, flags, quantisation, clipping, stuck and dropped samples, saturated inputs."""
    faults, remarks, ny = [], [], records[0].ny
    lattice = np.array([lattice_step([r.y[_good(r), c] for r in records]) for c in range(ny)])
    bad = [~_good(r) for r in records]
    for c in range(ny):
        faults += _channel(records, c, lattice[c])
    faults += _stuck(records, lattice, bad) + _dropped(records, lattice, bad)
    for i, r in enumerate(records):
        remarks += _remarks(r, i)
    drives = [fault for i, r in enumerate(records) for fault in _clipped_drives(r, i)]
    remarks += [_drive_words(fault) for fault in drives]
    return DataCheck(faults, remarks, lattice, bad, drives)


def refuse_unusable(records: list[Record], role: str) -> None:
    """Raises InputError where an output is one value in all of the records (no effect explains a sensor that is dead),
    and where numbers are too large for their cubes."""
    for values in (part for r in records for part in (r.u, r.y)):
        if np.nanmax(np.abs(values), initial=0.0) > LARGEST:
            raise InputError(
                f"{role}: values above {LARGEST:g} cannot be worked with: give the records in other units."
            )
    for c in range(records[0].ny):
        y = np.concatenate([r.y[_good(r), c] for r in records])
        if len(y) and np.ptp(y) == 0:
            raise InputError(
                f"{role}: output {c} is {y[0]:g} in all {len(y)} samples: its sensor is dead, or nothing moved. "
                "Give records in which it moves, or leave the output out of the records and of output_map."
            )


def refuse_too_long(records: list[Record], role: str, n: int) -> None:
    """Raises InputError where records of n degrees of freedom would fill the memory; holes count as samples."""
    samples = sum(_on_a_grid(r) for r in records)
    if samples * n > MOST:
        raise InputError(
            f"{role}: {samples:,} samples of {n} degree(s) of freedom; the gap workflow takes {MOST // n:,} of them. "
            "Give a stretch of the record, or a lower sampling rate."
        )


def refuse_too_slow(records: list[Record], role: str, model: Model) -> None:
    """Raises InputError where every mode of the model lies above half the sampling rate: a matter of units, nearly always."""
    M, _, K = model.matrices
    lowest = float(np.sqrt(np.abs(np.linalg.eigvals(np.linalg.solve(M, K))).min())) / (2 * np.pi)
    for record in records:
        half = 0.5 / float(np.median(np.diff(record.t))) if record.N > 1 else np.inf
        if lowest > half:
            raise InputError(
                f"{role}: the model's lowest natural frequency is {lowest:.3g} Hz, above half the record's sampling rate, "
                f"{half:.3g} Hz: nothing of it can be seen. Are the times in seconds, and mass and stiffness in kg and N/m?"
            )


def _on_a_grid(record: Record) -> int:
    step = float(np.median(np.diff(record.t))) if record.N > 1 else 0.0
    return max(record.N, round((record.t[-1] - record.t[0]) / step) + 1) if step > 0 else record.N


def _good(record: Record) -> np.ndarray:
    return np.ones(record.N, dtype=bool) if record.quality is None else record.quality == 0


def lattice_step(parts: list[Array]) -> float:
    """Step of the lattice that nearly all values lie on; 0 where there are many different values."""
    y = np.concatenate(parts)
    size = np.abs(y).max(initial=0.0) or 1.0
    values = np.unique(np.round(y / size, 12)) * size
    if len(values) > 0.3 * len(y) or len(values) < 3:
        return 0.0
    steps = np.diff(values)
    steps = steps[steps > 1e-9 * np.ptp(y)]
    if len(steps) == 0:
        return 0.0
    step = float(np.percentile(steps, 30))
    for offset in (0.0, float(values[len(values) // 2])):
        place = (y - offset) / step
        if np.mean(np.abs(place - np.round(place)) < 0.02) > 0.98:
            return step
    return 0.0


def _channel(records: list[Record], c: int, step: float) -> list[Fault]:
    y = np.concatenate([r.y[_good(r), c] for r in records])
    found, rms = [], float(np.std(y))
    if step > NOTICEABLE_STEP * rms:
        found.append(
            Fault(
                "quantisation",
                c,
                {"step": step},
                {"distinct_values": len(np.unique(y)), "step_over_rms": step / rms},
            )
        )
    limit, hits = _clip_limit(y, step)
    if limit:
        found.append(Fault("sensor_clipping", c, {"limit": limit}, {"samples_at_the_limit": hits}))
    return found


def _clip_limit(y: Array, step: float) -> tuple[float, int]:
    """Largest |value| where far more samples sit exactly there than just below it; 0 where there is no limit."""
    size = np.abs(y)
    top = float(size.max())
    hits = int(np.sum(size >= top * (1 - 1e-9)))
    if hits < max(FEWEST_CLIPPED, 0.001 * len(y)):
        return 0.0, 0
    if step and hits < 4 * np.sum(np.abs(size - (top - step)) < 0.1 * step) + 4:
        return 0.0, 0
    both = min(np.sum(y >= top * (1 - 1e-9)), np.sum(y <= -top * (1 - 1e-9)))
    if len(np.unique(y)) < 5:
        return 0.0, 0
    return (top, hits) if both or hits > 10 else (0.0, 0)


def _runs(same: np.ndarray) -> list[tuple[int, int]]:
    """(first, length) of the stretches where `same` is True."""
    edges = np.diff(np.concatenate([[0], same.astype(int), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return list(zip(starts.tolist(), (ends - starts).tolist()))


def _stuck(records: list[Record], lattice: Array, bad: list[np.ndarray]) -> list[Fault]:
    """A long stretch of one value in a channel that otherwise never repeats."""
    found = []
    for i, r in enumerate(records):
        for c in range(r.ny):
            y = r.y[:, c]
            same = (np.diff(y) == 0) & (np.abs(y[1:]) < np.abs(y).max() * (1 - 1e-9))
            if lattice[c] > NOTICEABLE_STEP * np.std(y):
                continue
            long = [(k, m) for k, m in _runs(same) if m >= max(20, 0.002 * r.N) and not _rests(y, k, m)]
            for k, m in long:
                start = float(r.t[k] - r.t[0])
                evidence = {"record": i, "first_sample": k, "samples": m + 1}
                found.append(
                    Fault(
                        "stuck_sensor", c, {"start": start, "duration": float(r.t[k + m] - r.t[k])}, evidence
                    )
                )
                bad[i][k + 1 : k + m + 1] = True
    return found


def _rests(y: Array, k: int, m: int) -> bool:
    """True where the machine itself stands still from sample k to k + m: it comes to rest and leaves it slowly."""
    step = np.abs(np.diff(y))
    return max(step[max(k - 1, 0)], step[min(k + m, len(step) - 1)]) < AT_REST * np.sqrt(np.mean(step**2))


def _dropped(records: list[Record], lattice: Array, bad: list[np.ndarray]) -> list[Fault]:
    """Rows that repeat the row before in every channel, here and there."""
    if np.any(lattice > 1e-6 * np.std(np.concatenate([r.y for r in records]), axis=0)):
        return []
    lost, total = 0, 0
    for i, r in enumerate(records):
        same = np.all(np.diff(r.y, axis=0) == 0, axis=1) & ~bad[i][1:]
        same &= np.any(np.abs(r.y[1:]) < np.abs(r.y).max(axis=0) * (1 - 1e-9), axis=1)
        same &= _moving(r.y)
        lost, total = lost + int(same.sum()), total + r.N
        if same.sum() >= 3:
            bad[i][1:] |= same
    if lost < max(3, 5e-4 * total):
        return []
    return [Fault("dropped_samples", None, {"share": lost / total}, {"repeated_rows": lost})]


def _moving(y: Array) -> np.ndarray:
    """(N - 1,) True where the samples around change at all: a machine at rest repeats its rows and drops none."""
    step = np.abs(np.diff(y, axis=0))
    width = min(11, len(step))
    around = np.column_stack([np.convolve(c, np.ones(width) / width, "same") for c in step.T])
    return np.any(around > 0.05 * np.sqrt(np.mean(step**2, axis=0)), axis=1)


def _remarks(record: Record, i: int) -> list[str]:
    remarks = []
    flagged = int(np.count_nonzero(record.quality)) if record.quality is not None else 0
    if flagged:
        remarks.append(f"record {i}: {flagged} of {record.N} samples are flagged and left out")
    if not record.is_uniform:
        remarks.append(f"record {i}: the time stamps have holes; they are left out")
    return remarks


def _clipped_drives(record: Record, i: int) -> list[Fault]:
    """Inputs of many values that sit at their largest and at their smallest one."""
    found = []
    for c in range(record.nu):
        u = record.u[:, c]
        high, low = np.mean(u == u.max()), np.mean(u == u.min())
        if len(np.unique(u)) > 20 and min(high, low) > 0.002:
            evidence = {"record": i, "from": float(u.min()), "to": float(u.max()), "share": float(high + low)}
            found.append(Fault("saturation", c, {"limit": float(np.abs(u).max())}, evidence))
    return found


def _drive_words(fault: Fault) -> str:
    seen = fault.evidence
    return (
        f"record {seen['record']}: input {fault.channel} sits at its extremes {seen['from']:g} and {seen['to']:g} for "
        f"{100 * seen['share']:.2g} % of the samples: the drive is clipped as recorded"
    )
