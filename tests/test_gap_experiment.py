"""Where two effects fit alike, gap writes the experiment that would tell them apart; simulate and measure take it."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml

from sysid_bench.__main__ import main
from sysid_bench.effects.actuator_lag import ActuatorLag
from sysid_bench.files import write_model
from sysid_bench.mechanics.nonlinear import simulate
from sysid_bench.nouns import Model, Plant, Record
from sysid_bench.records import read_record, write_record

H, N = 0.05, 3000
NOMINAL = Model([[1.0]], [[0.3]], [[1.0]], hold="cubic")


@pytest.fixture(scope="module")
def answered(tmp_path_factory):
    """A lag seen in a band too narrow to tell it from a delay."""
    folder = tmp_path_factory.mktemp("alike")
    rng = np.random.default_rng(5)
    plant = Plant([[1.0]], [[0.3]], [[1.0]], effects=(ActuatorLag(0, 0.12),))
    t = H * np.arange(N)
    for name in ("train", "test"):
        phases = rng.uniform(0, 6.28, 12)
        u = sum(np.sin(w * t + p) for w, p in zip(np.linspace(0.5, 1.3, 12), phases))[:, None]
        y = simulate(plant, u, H, "cubic").y
        write_record(
            Record(t, u, y + 0.05 * y.std() * rng.normal(size=y.shape), "cubic"), folder / f"{name}.mcap"
        )
    write_model(NOMINAL, folder / "model.yaml")
    words = [f"{k}={folder / k}.mcap" for k in ("train", "test")]
    words += [f"model={folder / 'model.yaml'}", f"out={folder / 'gap'}", "recording=false"]
    assert main(["gap", *words]) == 0
    return folder / "gap"


def test_the_class_is_named_with_the_experiment_that_splits_it(answered):
    values = json.loads((answered / "gap.json").read_text())
    (effect,) = values["effects"]
    names = {effect["name"], *(x["name"] for x in effect["not_told_apart_from"])}
    assert {"input_delay", "actuator_lag"} <= names
    rivals = [(x["name"], str(x["dof"])) for x in effect["told_apart_from"] + effect["not_told_apart_from"]]
    assert len(rivals) == len(set(rivals))
    asked = values["experiment"]
    assert asked["settles"] and {"input_delay", "actuator_lag"} <= set(asked["between"])
    stored = yaml.safe_load((answered / "experiment.yaml").read_text())
    assert stored == asked["excitation"] and stored["_target_"].startswith("sysid_bench.excitations.")


def test_simulate_and_measure_take_the_experiment(answered, tmp_path):
    excitation, seconds = f"excitation={answered / 'experiment.yaml'}", N * H
    out = tmp_path / "run.mcap"
    words = [f"model={answered / 'model.yaml'}", f"sampling.h_s={H}", f"sampling.N={N}", "noise=none"]
    assert main(["simulate", excitation, *words, f"out={out}"]) == 0
    assert read_record(out).N == N
    words = ["rig=second_order_1", "dry_run=true", "amplitude=0.2", f"seconds={seconds}"]
    assert main(["measure", excitation, *words, f"out={tmp_path / 'dry.mcap'}"]) == 0
    assert (tmp_path / "dry.preview.png").is_file()


def test_the_experiment_tells_them_apart(answered, tmp_path):
    """The true plant under the proposed excitation: now only the true name is left."""
    from sysid_bench.build import build

    node = yaml.safe_load((answered / "experiment.yaml").read_text())
    plant = Plant([[1.0]], [[0.3]], [[1.0]], effects=(ActuatorLag(0, 0.12),))
    rng, words = np.random.default_rng(8), []
    for name in ("train", "test"):
        signal = build(node).signal(N, H, 1, rng)
        y = simulate(plant, signal.u, H, signal.hold, period=signal.period).y
        record = Record(
            H * np.arange(N), signal.u, y + 0.03 * rng.normal(size=y.shape), signal.hold, period=signal.period
        )
        write_record(record, tmp_path / f"{name}.mcap")
        words.append(f"{name}={tmp_path / name}.mcap")
    write_model(Model([[1.0]], [[0.3]], [[1.0]]), tmp_path / "model.yaml")
    out = tmp_path / "gap"
    assert (
        main(
            [
                "gap",
                *words,
                f"model={tmp_path / 'model.yaml'}",
                f"out={out}",
                "views=false",
                "recording=false",
            ]
        )
        == 0
    )
    (effect,) = json.loads((out / "gap.json").read_text())["effects"]
    assert effect["name"] == "actuator_lag"
    assert "input_delay" not in {x["name"] for x in effect["not_told_apart_from"]}


def test_a_file_that_is_no_option_is_refused(tmp_path, capsys):
    (tmp_path / "wrong.yaml").write_text("amplitude: 3\n")
    assert main(["simulate", f"excitation={tmp_path / 'wrong.yaml'}", f"out={tmp_path / 'x.mcap'}"]) == 2
    assert "_target_" in capsys.readouterr().err
