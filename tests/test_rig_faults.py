"""Every fault, injected into a device process, met by a host process: detected, counted, stopped or flagged."""

import contextlib
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from rig_processes import emulator, faults, truth_of

from sysid_bench.__main__ import main
from sysid_bench.nouns import CORRUPTED, DUPLICATED, LATE, LOST, REORDERED, STUCK, Record
from sysid_bench.records import read_record

FIRST = 50  # run-in of 0.1 s at 500 Hz
AT = 300  # sample of the run at which the fault comes
CASES = {
    "drop": {"kind": "drop", "count": 2},
    "duplicate": {"kind": "duplicate", "count": 2},
    "reorder": {"kind": "reorder", "frames": "FEEDBACK_1", "count": 1},
    "delay": {"kind": "delay", "count": 100},
    "corrupt": {"kind": "corrupt", "count": 2},
    "forces": {"kind": "drop", "frames": "force", "count": 2},
    "stuck_sensor": {"kind": "stuck_sensor", "channel": 2, "count": 400},
    "device_reset": {"kind": "device_reset"},
    "bus_off": {"kind": "bus_off"},
    "silence": {"kind": "silence"},
    "heavy_loss": {"kind": "drop", "probability": 0.05},
}


@dataclass
class Met:
    code: int
    err: str
    record: Record
    truth: dict

    @property
    def counts(self) -> dict:
        return self.record.origin["frames"]

    def flagged(self, bit: int) -> list[int]:
        return [int(k) for k in FIRST + np.flatnonzero(self.record.quality & bit)]


def measured(bus: str, log: Path) -> tuple[int, str]:
    """The host in this process: (exit code, what it says on stderr)."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        code = main(["measure", bus, f"out={log}", "seconds=1.4", "soft_start_s=0.1"])
    return code, said.getvalue()


def runs_of(path: Path) -> list[dict]:
    """Force and output by sample number, run by run."""
    found: list[dict] = []
    for row in truth_of(path):
        if row["state"] == "running":
            if row["k"] == "0":
                found.append({})
            columns = [c for c in row if c[0] in "uy" and c[1:].isdigit()]
            u, y = (np.array([float(row[c]) for c in columns if c[0] == letter]) for letter in "uy")
            found[-1][int(row["k"])] = (u, y)
    return found


def met(names: list[str], folder: Path) -> dict[str, Met]:
    """One device process that meets a fault in each of its runs."""
    truth = folder / f"{names[0]}.csv"
    nodes = [{"at_sample": AT, **CASES[name], "run": i + 1} for i, name in enumerate(names)]
    with emulator(faults(*nodes), "hardware.noise_rms=1e-3", truth=truth) as bus:
        said = [measured(bus, folder / f"{name}.mcap") for name in names]
    records = [read_record(folder / f"{name}.mcap") for name in names]
    return {n: Met(*s, r, t) for n, s, r, t in zip(names, said, records, runs_of(truth), strict=True)}


@pytest.fixture(scope="module")
def outcome(tmp_path_factory) -> dict[str, Met]:
    folder, silent = tmp_path_factory.mktemp("faults"), ["bus_off", "silence"]  # no run after these
    found = met([name for name in CASES if name not in silent], folder)
    for name in silent:
        found |= met([name], folder)
    return found


@pytest.mark.parametrize("name", [name for name in CASES if name != "stuck_sensor"])
def test_no_wrong_sample_is_without_a_flag(outcome: dict[str, Met], name: str) -> None:
    record, truth = outcome[name].record, outcome[name].truth
    for i in range(record.N):
        u, y = truth[FIRST + i]
        known = np.isfinite(record.y[i])
        assert known.all() or record.quality[i] & LOST
        assert np.abs(record.y[i] - y)[known].max(initial=0.0) < 0.51e-6
        assert np.array_equal(record.u[i], u)


@pytest.mark.parametrize(
    ("name", "counted", "times", "bit", "samples"),
    [
        ("drop", "lost", 6, LOST, [AT, AT + 1]),
        ("duplicate", "duplicated", 6, DUPLICATED, [AT, AT + 1]),
        ("reorder", "reordered", 1, REORDERED, [AT]),
        ("corrupt", "corrupted", 6, CORRUPTED, [AT, AT + 1]),
    ],
)
def test_faults_of_frames_are_counted_and_flagged(
    outcome: dict[str, Met], name: str, counted: str, times: int, bit: int, samples: list[int]
) -> None:
    run = outcome[name]
    assert run.code == 0, run.err
    assert run.counts[counted] == times
    assert run.flagged(bit) == samples
    assert run.record.origin["valid"] is True


def test_forces_that_never_came_are_known_sample_by_sample(outcome: dict[str, Met]) -> None:
    """Lost on the way, some 100 samples before they are due: what the host then logs is what the device held."""
    run = outcome["forces"]
    assert run.code == 0 and run.counts["lost"] == 0
    flagged = len(run.flagged(LOST))
    assert 0 < flagged <= run.counts["forces_missed"] <= 3 * flagged
    assert np.isfinite(run.record.y).all() and run.record.origin["valid"] is True


def test_a_burst_of_delay_is_flagged_late_and_nothing_is_lost(outcome: dict[str, Met]) -> None:
    run = outcome["delay"]
    assert run.code == 0 and run.counts["lost"] == 0
    late = run.flagged(LATE)
    assert len(late) == run.counts["late"] > 20 and set(range(AT, AT + 20)) <= set(late)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("stuck_sensor", "stuck sensor: output 3"),
        ("device_reset", "left the run by itself"),
        ("bus_off", "bus-off"),
        ("silence", "the device is silent"),
    ],
)
def test_faults_of_the_device_stop_the_run_with_the_reason(
    outcome: dict[str, Met], name: str, words: str
) -> None:
    run = outcome[name]
    assert run.code == 1 and words in run.err, run.err
    assert words in run.record.origin["stopped"] and run.record.N < 700


def test_a_stuck_sensor_leaves_no_good_sample_that_is_wrong(outcome: dict[str, Met]) -> None:
    record = outcome["stuck_sensor"].record
    held = np.arange(
        AT + 1 - FIRST, record.N
    )  # the sample at AT is the last true one; two equal ones before it are chance
    assert len(held) > 100  # it took the stuck time to be sure
    assert np.ptp(record.y[held, 2]) == 0 and np.all(record.quality[held] & STUCK)


def test_a_record_that_lost_too_much_is_marked_invalid(outcome: dict[str, Met]) -> None:
    run = outcome["heavy_loss"]
    assert run.code == 1 and "marked invalid" in run.err and "are lost" in run.err
    assert run.record.origin["valid"] is False
    assert run.counts["lost"] >= np.isnan(run.record.y).sum() > 50  # the run-out's are counted too
