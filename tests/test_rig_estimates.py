"""What is identified from a rig's record is what is identified from a simulation of the same experiment."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rig_processes import emulator, faults, measure

from sysid_bench import conf
from sysid_bench.build import build
from sysid_bench.mechanics.second_order import pack
from sysid_bench.mechanics.simulate import simulate
from sysid_bench.nouns import Estimate, NotApplicable, Record
from sysid_bench.records import read_record

PLANT = build(conf.option("plant", "three_dof"))
NOISE = 1e-3


def method(name: str):
    return build(conf.option("method", name))


def run(folder: Path, *device: str) -> Record:
    """40 s of the three masses at 500 Hz, twice as fast as real time."""
    with emulator(f"hardware.noise_rms={NOISE}", "pace=2", *device) as bus:
        code, out, err = measure(bus, folder / "run.mcap", "seconds=40", "pace=2", timeout=120)
    assert code == 0, out + err
    return read_record(folder / "run.mcap")


def simulated(record: Record) -> Record:
    """The same forces on the same plant from rest, simulated, with noise of the same size."""
    y = simulate(PLANT, record.u, 0.002, "zoh")
    noise = NOISE * np.random.default_rng(9).standard_normal(y.shape)
    return Record(0.002 * np.arange(record.N), record.u, y + noise, hold="zoh")


def theta(estimate: Estimate) -> tuple[np.ndarray, np.ndarray]:
    return pack(estimate.M, estimate.D, estimate.K), np.sqrt(np.diag(estimate.covariance))


def assert_same_within_intervals(estimate: Estimate, other: Estimate) -> None:
    (a, std_a), (b, std_b) = theta(estimate), theta(other)
    truth = pack(PLANT.mass, PLANT.damping, PLANT.stiffness)
    assert np.abs((a - b) / np.hypot(std_a, std_b)).max() < 4.5
    assert np.abs((a - truth) / std_a).max() < 4.5
    assert 0.5 < np.median(std_a / std_b) < 2.0


@pytest.mark.slow
def test_a_clean_run_gives_the_estimate_of_a_simulation(tmp_path: Path) -> None:
    record, model = run(tmp_path), PLANT.model().structure_only()
    assert record.all_good
    assert_same_within_intervals(
        method("spline_ml").fit(record, model), method("spline_ml").fit(simulated(record), model)
    )


@pytest.mark.slow
def test_half_a_percent_lost_still_does_for_methods_that_take_gaps(tmp_path: Path) -> None:
    lossy = faults({"kind": "drop", "frames": "feedback", "probability": 0.0016})  # three frames per sample
    record, model = run(tmp_path, lossy), PLANT.model().structure_only()
    assert 0.003 < np.mean(record.quality != 0) < 0.007
    assert_same_within_intervals(
        method("spline_ml").fit(record, model), method("spline_ml").fit(simulated(record), model)
    )
    for name in ("arx", "n4sid_d2c"):
        with pytest.raises(NotApplicable, match="flagged"):
            method(name).fit(record, model)
    good = replace(
        record, y=np.nan_to_num(record.y), quality=None
    )  # filled in silently, the gaps would spoil it
    spoilt = method("spline_ml").fit(good, model)
    truth = pack(PLANT.mass, PLANT.damping, PLANT.stiffness)
    fair = method("spline_ml").fit(record, model)
    assert np.abs(theta(spoilt)[0] - truth).max() > 5 * np.abs(theta(fair)[0] - truth).max()
