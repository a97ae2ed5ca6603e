"""A device and a host as two processes: clean runs, stops, kills."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from rig_processes import emulator, finish, measure, running, start, truth_of, wait_for

from sysid_bench.build import build
from sysid_bench.conf import option
from sysid_bench.mechanics.simulate import simulate
from sysid_bench.nouns import LOST
from sysid_bench.records import read_record
from sysid_bench.records.mcap_read import read_attachments

RERUN = Path(sys.executable).with_name("rerun")
FIRST = 250  # samples of the run-in: 0.5 s at 500 Hz


def assert_as_the_device_did(record, truth: Path, first: int = FIRST, resolution: float = 0.51e-6) -> None:
    did = running(truth)
    for i in range(record.N):
        u, y = did[first + i]
        good = record.quality[i] == 0
        known = np.isfinite(record.y[i])
        assert known.all() or not good
        assert np.abs(record.y[i] - y)[known].max(initial=0) <= resolution
        assert np.array_equal(record.u[i], u)


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """One clean run, looked at by several tests."""
    folder = tmp_path_factory.mktemp("clean")
    with emulator("hardware.drift_ppm=0", truth=folder / "truth.csv") as bus:
        code, out, err = measure(bus, folder / "run.mcap", "seconds=2")
    return folder, code, out, err


def test_a_clean_run_is_the_device_s_truth_sample_by_sample(clean) -> None:
    folder, code, out, err = clean
    assert code == 0, out + err
    record = read_record(folder / "run.mcap")
    assert (record.N, record.nu, record.ny, record.hold) == (1000, 3, 3, "zoh")
    assert not np.any(record.quality & LOST)
    assert record.units["u"] == ["N", "N", "N"] and record.units["y"] == ["m", "m", "m"]
    assert_as_the_device_did(record, folder / "truth.csv")


def test_the_log_holds_everything_and_says_what_made_it(clean) -> None:
    folder, *_ = clean
    origin = read_record(folder / "run.mcap").origin
    assert origin["source"] == "measured" and origin["rig"] == "second_order_3" and origin["valid"] is True
    assert origin["frames"]["lost"] == 0 and origin["frames"]["received"] > 6000
    assert abs(origin["clock"]["drift_ppm"]) < 300
    files = read_attachments(folder / "run.mcap")
    assert {"rig.dbc", "config.yaml"} <= set(files) and b"BO_ 32 SYNC" in files["rig.dbc"]
    info = subprocess.run(
        [RERUN, "mcap", "info", folder / "run.mcap"], capture_output=True, text=True, check=False
    )
    for topic in ("/record", "/outside", "/command", "/feedback", "/state", "/can", "/statistics"):
        assert topic in info.stdout + info.stderr, info.stdout + info.stderr


def test_rerun_finds_the_log_sound(clean) -> None:
    folder, *_ = clean
    check = subprocess.run(
        [RERUN, "mcap", "check", folder / "run.mcap"], capture_output=True, text=True, check=False
    )
    assert check.returncode == 0, check.stdout + check.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_stops_the_device_first_and_closes_the_log(tmp_path: Path, number: int) -> None:
    with emulator(truth=tmp_path / "truth.csv") as bus:
        host = start("measure", bus, f"out={tmp_path / 'run.mcap'}", "seconds=60")
        wait_for(tmp_path / "run.mcap", 200_000)
        host.send_signal(number)
        code, _, err = finish(host)
        time.sleep(1.0)
    assert code == 1 and "stopped: interrupted" in err
    last = truth_of(tmp_path / "truth.csv")[-1]
    assert (last["state"], last["fault"], float(last["u1"])) == ("fault", "emergency_stop", 0.0)
    record = read_record(tmp_path / "run.mcap")
    assert record.origin["stopped"] == "interrupted"
    assert_as_the_device_did(record, tmp_path / "truth.csv")


def test_a_killed_host_leaves_a_safe_device_and_a_log_to_recover(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    with emulator(truth=tmp_path / "truth.csv") as bus:
        host = start("measure", bus, f"out={log}", "seconds=60")
        wait_for(log, 300_000)
        host.kill()
        killed = time.monotonic()
        host.communicate(timeout=10)
        time.sleep(3.0)  # the device is to have had its turn, however busy the machine
    rows = truth_of(tmp_path / "truth.csv")
    silent = [float(r["time"]) for r in rows if r["fault"] == "host_silent"]
    turns = np.array([killed, *(float(r["time"]) for r in rows if killed < float(r["time"]) <= silent[0])])
    waited = np.diff(
        turns
    ).max()  # for its turn, on a busy machine: before the last heartbeat, before the stop
    assert silent[0] - killed < 0.5 + 0.02 + 2 * waited  # watchdog_s and a few ticks
    assert all(
        float(r["u1"]) == float(r["u2"]) == float(r["u3"]) == 0.0
        for r in rows
        if float(r["time"]) >= silent[0]
    )
    code, out, err = finish(start("recover", str(log)))
    assert code == 0 and "cut off" in out, out + err
    record = read_record(tmp_path / "run.recovered.mcap")
    assert record.N > 200 and record.origin["valid"] is True and record.origin["recovered_from"] == str(log)
    assert_as_the_device_did(record, tmp_path / "truth.csv")


def test_a_rig_without_counters_is_measured_too(tmp_path: Path) -> None:
    with emulator(
        "rig=odrive_simple", "plant=one_dof", "hardware.noise_rms=1e-4", truth=tmp_path / "truth.csv"
    ) as bus:
        _, out, err = measure(bus, tmp_path / "run.mcap", "rig=odrive_simple", "seconds=4")
    record = read_record(tmp_path / "run.mcap")
    assert record.N == 400 and record.units["y"] == ["rad"], out + err
    did = running(tmp_path / "truth.csv")
    u, y = (np.array([did[k][part][0] for k in sorted(did)]) for part in (0, 1))
    offsets = range(len(y) - 400)  # which arrival was the first is for the host to choose
    start_at = min(offsets, key=lambda i: np.abs(y[i : i + 400] - record.y[:, 0]).max())
    good = record.quality == 0
    assert good.mean() > 0.9
    assert np.abs(record.y[:, 0] - y[start_at : start_at + 400])[good].max() < 1e-5
    same = record.u[:, 0] == u[start_at : start_at + 400]
    assert np.mean(same[good]) > 0.97  # a torque that comes after its tick is applied at the next one


def test_hidden_effects_move_the_device_and_are_nowhere_in_the_log(tmp_path: Path) -> None:
    effects = tmp_path / "effects.yaml"
    effects.write_text(
        "effects:\n  - {name: coulomb_friction, dof: 0, parameters: {force: {value: 0.2, unit: N}}}\n"
    )
    with emulator(f"effects={effects}", "hardware.noise_rms=0", truth=tmp_path / "truth.csv") as bus:
        code, out, err = measure(bus, tmp_path / "run.mcap", "seconds=1")
    assert code == 0, out + err
    record = read_record(tmp_path / "run.mcap")
    assert_as_the_device_did(record, tmp_path / "truth.csv")
    plant = build(option("plant", "three_dof"))
    smooth = simulate(plant, np.concatenate([np.zeros((1, 3)), record.u]), 0.002, "zoh")[1:]
    assert np.abs(record.y - smooth)[-1].max() > 1e-3  # friction is felt
    assert "coulomb" not in str(record.origin) + str(read_attachments(tmp_path / "run.mcap"))
