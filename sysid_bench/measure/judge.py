"""samples of a run as they came -> times on the host's clock, flags, and whether the record may be used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sysid_bench.measure.arrivals import number_arrivals
from sysid_bench.measure.clock import ClockFit, fit_clock
from sysid_bench.nouns import LATE, LOST, STUCK, Array


@dataclass(frozen=True)
class Verdict:
    """Clock and quality of a record. valid: at most `max_lost` of its samples are lost, and nothing unexplained."""

    clock: ClockFit | None
    counts: Mapping[str, int]
    lost_share: float
    valid: bool
    reason: str

    def as_origin(self) -> dict[str, Any]:
        clock = (
            None
            if self.clock is None
            else asdict(self.clock) | {"applied": self.clock.significant and self.valid}
        )
        return {
            "clock": clock, "frames": dict(self.counts), "lost_share": self.lost_share,
            "valid": self.valid, "invalid_reason": self.reason,
        }  # fmt: skip


@dataclass(frozen=True)
class Rules:
    """How a rig's samples are judged: kept in the log's origin so that `recover` judges as `measure` does."""

    rate_hz: float
    tick_unit_s: float
    numbered: bool
    late_s: float
    max_lost: float
    max_drift_ppm: float
    stuck_s: float | None


def judged(
    columns: Mapping[str, list[float]], rules: Rules, counts: Mapping[str, int]
) -> tuple[dict[str, np.ndarray], Verdict]:
    """Columns with times on the host's clock and late samples flagged, and the verdict."""
    table = {name: np.array(values) for name, values in columns.items()}
    if not rules.numbered:
        table = _numbered(table, rules)
    device_s = _device_times(table, rules)
    good = np.isfinite(table["host_s"])
    clock = fit_clock(device_s[good], table["host_s"][good])
    quality = table["quality"].astype(np.uint8)
    if clock is not None:
        late = good & (clock.delays(device_s, table["host_s"]) > rules.late_s)
        quality[late] |= LATE
    quality[_stuck(table, rules)] |= STUCK
    scale = clock.scale if clock is not None and clock.significant and not _runaway(clock, rules) else 1.0
    table["t"] = scale * (device_s - device_s[0])
    table["quality"] = quality
    counts = {**counts, "late": int(np.count_nonzero(quality & LATE))}
    counts |= {"stuck": int(np.count_nonzero(quality & STUCK))}
    if not rules.numbered:
        counts["lost"] = int(np.count_nonzero(quality & LOST))
    return table, _verdict(clock, counts, quality, rules)


def _stuck(table: Mapping[str, np.ndarray], rules: Rules) -> np.ndarray:
    """(N,) bool: samples of an output that had moved and then repeats itself bit for bit for stuck_s."""
    stuck = np.zeros(len(table["k"]), dtype=bool)
    if rules.stuck_s is None:
        return stuck
    shortest = max(2, round(rules.stuck_s * rules.rate_hz))
    for name in (name for name in table if name.startswith("y")):
        changes = np.flatnonzero(np.diff(table[name]) != 0) + 1
        for start, end in zip(changes, [*changes[1:], len(stuck)]):
            if end - start > shortest:
                stuck[start:end] = True
    return stuck


def _verdict(clock: ClockFit | None, counts: Mapping[str, int], quality: np.ndarray, rules: Rules) -> Verdict:
    share = float(np.mean(quality & LOST != 0))
    reasons = []
    if share > rules.max_lost:
        reasons.append(f"{100 * share:.2f} % of the samples are lost, more than {100 * rules.max_lost:g} %")
    if counts.get("forces_uncertain"):
        reasons.append(f"{counts['forces_uncertain']} forces are not known for certain")
    if clock is not None and clock.significant and _runaway(clock, rules):
        reasons.append(
            f"the clocks of device and host differ by {clock.drift_ppm:.0f} ppm, more than {rules.max_drift_ppm:g}: "
            "the device overran, or its rate is not the rig's rate_hz"
        )
    return Verdict(clock, counts, share, not reasons, "; ".join(reasons))


def _runaway(clock: ClockFit, rules: Rules) -> bool:
    """No pair of clocks differs so much: something else is wrong, and times stay those of the device."""
    return abs(clock.drift_ppm) > rules.max_drift_ppm


def _device_times(table: Mapping[str, np.ndarray], rules: Rules) -> Array:
    """s by the device's clock: whole periods where its ticks say so, else the ticks, nominal where they are missing."""
    nominal = table["k"] / rules.rate_hz
    known = table["tick"] >= 0
    if not known.any():
        return nominal
    by_tick = np.array(table["tick"], dtype=float) * rules.tick_unit_s
    start = np.median((by_tick - nominal)[known])
    if np.abs(by_tick - nominal - start)[known].max() <= 1.01 * rules.tick_unit_s:
        return nominal
    return np.where(known, by_tick - start, nominal)


def _numbered(table: dict[str, np.ndarray], rules: Rules) -> dict[str, np.ndarray]:
    """Numbers by times of arrival; rows for the samples lost between."""
    k, _ = number_arrivals(table["host_s"], 1 / rules.rate_hz)
    N = int(k[-1]) + 1
    row_of = np.searchsorted(k, np.arange(N), side="right") - 1
    lost = k[row_of] != np.arange(N)
    full = {name: values[row_of].copy() for name, values in table.items()}
    for name in full:
        if name.startswith("y") or name == "host_s":
            full[name][lost] = np.nan
    for name in full:
        if name.startswith("u"):  # the force that the arrival before called for
            after = np.minimum(row_of + 1, len(k) - 1)
            full[name][lost] = table[name][after][lost]
    full["quality"] = np.where(lost, LOST, full["quality"])
    full["k"] = np.arange(N) + int(table["k"][0])
    return full
