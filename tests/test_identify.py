"""identify from the command line: estimate.json as specified, intervals that hold, and one clear refusal each."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from sysid_bench import effects
from sysid_bench.__main__ import main
from sysid_bench.build import build
from sysid_bench.conf import compose, groups
from sysid_bench.doors.identify import cautions, fitted, order_remarks
from sysid_bench.estimate_table import tables
from sysid_bench.files import read_estimate, read_model, write_model
from sysid_bench.mechanics.second_order import pack
from sysid_bench.nouns import Estimate, InputError, Model, Plant, Record
from sysid_bench.pairing import pair
from sysid_bench.records import read_record, write_record

STRUCTURE = "degrees_of_freedom: 3\ninput_intersample: {hold}\n"


def run(*words: object) -> int:
    return main([str(word) for word in words])


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """run.csv and run.mcap of the same run with a zero-order hold, and a model.yaml with the structure."""
    folder = tmp_path_factory.mktemp("identify")
    for name in ("run.csv", "run.mcap"):
        words = ("plant=three_dof", "excitation=random_binary", "noise.snr_db=30")
        assert run("simulate", *words, "sampling.h_s=0.2", "sampling.N=2000", f"out={folder / name}") == 0
    (folder / "model.yaml").write_text(STRUCTURE.format(hold="zoh"))
    return folder


def identify(folder: Path, out: Path, *more: str, record: str = "run.csv", model: str = "model.yaml") -> int:
    words = (f"record={folder / record}", f"model={folder / model}", "method=n4sid_d2c", f"out={out}")
    return run("identify", *words, "views=false", *more)


def refused(capsys, folder: Path, out: Path, *more: str, **names: str) -> str:
    capsys.readouterr()
    assert identify(folder, out, *more, **names) == 2
    message = capsys.readouterr().err.strip()
    assert "\n" not in message and "Traceback" not in message
    return message


def truth() -> Plant:
    return build(compose("simulate", ["plant=three_dof", "out=x.csv"])["plant"])


def test_a_csv_and_a_model_give_the_estimate_of_the_contract(folder, tmp_path, capsys):
    assert identify(folder, tmp_path) == 0
    found = json.loads((tmp_path / "estimate.json").read_text())
    assert (found["status"], found["method"]) == ("ok", "n4sid_d2c")
    assert found["seconds"] > 0
    plant = truth()
    for name, wanted in (("M", plant.mass), ("D", plant.damping), ("K", plant.stiffness)):
        value, std = np.array(found[name]["value"]), np.array(found[name]["std"])
        assert np.all(np.abs(value - wanted) < 5 * std), f"{name} is where its standard errors say"
        assert np.all(std < 0.1 * np.abs(wanted).max())
    assert np.shape(found["poles"]) == (6, 2)
    assert found["origin"]["config"]["record"] == str(folder / "run.csv")
    assert set(found["origin"]["inputs"]) == {str(folder / "run.csv"), str(folder / "model.yaml")}
    said = capsys.readouterr().out
    assert "95 % intervals" in said and " ± " in said and str(tmp_path / "estimate.json") in said


def test_the_estimate_is_a_model_again(folder, tmp_path):
    assert identify(folder, tmp_path) == 0
    estimate, _ = read_estimate(tmp_path / "estimate.json")
    model = read_model(tmp_path / "model_estimate.yaml")
    assert np.array_equal(model.stiffness, estimate.K)
    assert model.hold == "zoh"
    assert (
        run(
            "simulate",
            f"model={tmp_path / 'model_estimate.yaml'}",
            "sampling.N=50",
            f"out={tmp_path / 'a.csv'}",
        )
        == 0
    )


def test_csv_and_mcap_of_the_same_run_give_the_same_estimate(folder, tmp_path):
    values = []
    for record in ("run.csv", "run.mcap"):
        assert identify(folder, tmp_path / record, record=record) == 0
        values.append(json.loads((tmp_path / record / "estimate.json").read_text()))
    assert values[0]["M"] == values[1]["M"] and values[0]["poles"] == values[1]["poles"]
    assert values[1]["origin"]["record"]["seed"] == 1, "the record's own origin is kept"


@pytest.mark.parametrize("method", groups()["method"])
def test_every_method_takes_files(folder, tmp_path, method):
    write_model(replace(truth().model(), hold="zoh"), tmp_path / "full.yaml")
    code = identify(folder, tmp_path, f"method={method}", model=str(tmp_path / "full.yaml"))
    found = json.loads((tmp_path / "estimate.json").read_text())
    if method.startswith(("peer_", "discrete_lagrangian")) and code == 1:
        assert found["status"] == "not_applicable" and found["reason"], "absent packages are named"
    else:
        assert (code, found["status"]) == (0, "ok")


def test_the_report_is_written(folder, tmp_path):
    words = (
        f"record={folder / 'run.csv'}",
        f"model={folder / 'model.yaml'}",
        "method=n4sid_d2c",
        f"out={tmp_path}",
    )
    assert run("identify", *words) == 0
    page = (tmp_path / "report.html").read_text()
    assert "n4sid_d2c" in page and "<img" in page
    assert list((tmp_path / "figures").glob("*.svg"))


def test_an_unknown_hold_is_assumed_aloud(folder, tmp_path, capsys):
    (tmp_path / "silent.yaml").write_text("degrees_of_freedom: 3\n")
    assert identify(folder, tmp_path, model=str(tmp_path / "silent.yaml")) == 0
    assert "zero-order hold is assumed" in capsys.readouterr().err
    found = json.loads((tmp_path / "estimate.json").read_text())
    assert found["diagnostics"]["hold"] == "zoh"
    assert "zero-order hold is assumed" in found["diagnostics"]["remarks"][0]


def test_a_short_record_is_called_short(folder, tmp_path, capsys):
    record = read_record(folder / "run.mcap")
    short = Record(record.t[:120], record.u[:120], record.y[:120], hold="zoh")
    write_record(short, tmp_path / "short.csv")
    identify(folder, tmp_path, record=str(tmp_path / "short.csv"))
    assert "periods of the slowest mode" in capsys.readouterr().err


def test_a_method_that_says_no_leaves_its_reason(folder, tmp_path, capsys):
    record = read_record(folder / "run.mcap")
    quality = np.zeros(record.N, np.uint8)
    quality[7] = 1
    write_record(Record(record.t, record.u, record.y, quality=quality), tmp_path / "flagged.csv")
    (tmp_path / "model_estimate.yaml").write_text("left over from an earlier run")
    assert identify(folder, tmp_path, record=str(tmp_path / "flagged.csv")) == 1
    found = json.loads((tmp_path / "estimate.json").read_text())
    assert found["status"] == "not_applicable" and "flagged" in found["reason"]
    assert "not_applicable" in capsys.readouterr().out
    assert not (tmp_path / "model_estimate.yaml").exists()


class Broken:
    """A method with a bug."""

    nominal = False

    def fit(self, record: Record, model: Model) -> Estimate:
        raise ZeroDivisionError("no step left")


def test_a_method_that_breaks_is_a_status_with_its_traceback_beside(tmp_path):
    estimate, _ = fitted(Broken(), record_of(), Model(n=1), tmp_path)
    assert estimate.status == "error" and "ZeroDivisionError: no step left" in estimate.reason
    assert "in fit" in (tmp_path / "traceback.txt").read_text()


def test_cautions():
    model = Model(np.eye(1), np.eye(1), np.eye(1), effects=(effects.effect("coulomb_friction"),))
    poles = np.array([0.01 + 20j, 0.01 - 20j, 0.0, 0.0])
    told = cautions(record_of(), model, Estimate(poles=poles))
    assert [
        word in line for word, line in zip(("coulomb_friction", "2.9 periods", "unstable"), told, strict=True)
    ] == [True] * 3
    assert cautions(record_of(), Model(n=1), Estimate(poles=np.array([-1.0, -2.0]))) == []


def test_what_identify_refuses(folder, tmp_path, capsys):
    def with_model(text: str) -> str:
        (tmp_path / "model.yaml").write_text(text)
        return refused(capsys, folder, tmp_path / "out", model=str(tmp_path / "model.yaml"))

    assert "3 input(s) and 3 output(s), the model 2 and 2" in with_model("degrees_of_freedom: 2\n")
    assert "input_map (4 x 3)" in with_model("degrees_of_freedom: 4\n")
    assert "sample_time: 0.1 s, the record's step is 0.2" in with_model(
        "degrees_of_freedom: 3\nsample_time: 0.1\n"
    )
    assert "unknown key 'n'" in with_model("n: 3\n")
    model = f"model={folder / 'model.yaml'}"
    capsys.readouterr()
    for words, wanted in (
        ((f"record={tmp_path / 'no.csv'}", model, "method=arx", f"out={tmp_path}"), "no file"),
        ((f"record={folder / 'run.csv'}", "method=arx", f"out={tmp_path}"), "identify needs model"),
        ((f"record={folder / 'run.csv'}", model, "method=magic", f"out={tmp_path}"), "n4sid_d2c"),
        ((f"record={folder / 'run.csv'}", model, "method=arx", "out=/dev/null/x"), "a folder is wanted"),
        ((f"record={folder / 'run.csv'}", model, "method=arx", "method.na=0", f"out={tmp_path}"), "na"),
        ((f"record={folder / 'run.csv'}", model, "method=arx", "topic=/x", f"out={tmp_path}"), ".mcap"),
    ):
        assert run("identify", *words) == 2
        assert wanted in capsys.readouterr().err


def record_of(nu: int = 1, **more) -> Record:
    return Record(np.arange(10) * 0.1, np.ones((10, nu)), np.ones((10, 1)), **more)


def test_units_are_checked_where_both_say_them():
    record = record_of(units={"t": "s", "u": ["N"], "y": ["mm"]})
    for units in ({}, {"u": ["N"]}, {"y": "mm"}, {"mass": "kg"}):
        pair(record, Model(n=1, units=units))
    with pytest.raises(InputError, match="units of y1 disagree: 'm' in the model, 'mm' in the record"):
        pair(record, Model(n=1, units={"y": ["m"]}))
    with pytest.raises(InputError, match="units of t disagree"):
        pair(record, Model(n=1, units={"t": "ms"}))


@pytest.mark.parametrize(
    ("of_record", "of_model", "used", "word"),
    [
        ("cubic", None, "cubic", None),
        (None, "foh", "foh", None),
        ("cubic", "zoh", "zoh", "model's is used"),
        (None, None, "zoh", "assumed"),
    ],
)
def test_the_models_hold_decides(of_record, of_model, used, word):
    record, model, remarks = pair(record_of(hold=of_record), Model(n=1, hold=of_model))
    assert record.hold == model.hold == used
    assert (word is None and remarks == []) or word in remarks[0]


def test_tables_say_what_is_known():
    big = np.diag(np.arange(1.0, 7.0))
    covariance = np.eye(63) * 1e-4
    shown = {
        table.title: table
        for table in tables(Estimate(big, big, big, covariance, poles=np.array([1j, -1j, -2.0])))
    }
    assert list(shown) == [
        *(
            f"{name} ({word}, SI), 95 % intervals"
            for name, word in zip("MDK", ("mass", "damping", "stiffness"))
        ),
        "modes",
    ]
    assert shown["M (mass, SI), 95 % intervals"].row_count == 6
    assert "15 more off the diagonal" in shown["M (mass, SI), 95 % intervals"].caption
    assert shown["modes"].row_count == 2, "a conjugate pair is one mode"
    assert next(tables(Estimate(big, big, big))).title.endswith("no intervals")


@pytest.mark.slow
@pytest.mark.full
@pytest.mark.parametrize("method", ["variational_pem", "spline_ml", "n4sid_d2c", "arx"])
def test_intervals_cover_the_truth(tmp_path, method):
    """200 runs: each 95 % interval of M, D, K holds the truth in 90-99 % of them, on average over the entries."""
    runs, inside = 200, []
    smooth = method in ("variational_pem", "spline_ml")  # the input for which each is made
    words = (
        ["excitation=cubic_noise", "sampling.h_s=0.05"]
        if smooth
        else ["excitation=random_binary", "sampling.h_s=0.2"]
    )
    words += ["plant=three_dof", "sampling.N=2000", "noise.snr_db=20", "out=x.csv"]
    cfg = compose("simulate", words)
    plant, parts = build(cfg["plant"]), [build(cfg[name]) for name in ("excitation", "noise", "sampling")]
    fit = build(compose("identify", [f"method={method}", "record=x", "model=x", "out=x"])["method"])
    wanted = pack(plant.mass, plant.damping, plant.stiffness)
    path = tmp_path / "model.yaml"
    write_model(plant.model().structure_only(), path)
    for seed in range(runs):
        acquired = build(cfg["source"]).acquire(plant, *parts, np.random.default_rng(seed))
        record, model, _ = pair(acquired.record, read_model(path))
        estimate, _ = fitted(fit, record, model, tmp_path)
        assert estimate.status == "ok", estimate.reason
        found = pack(estimate.M, estimate.D, estimate.K)
        inside.append(np.abs(found - wanted) < 1.96 * np.sqrt(np.diag(estimate.covariance)))
    covered = np.mean(inside)
    per_entry = np.mean(inside, axis=0)
    print(f"{method}: {covered:.1%} on average, {per_entry.min():.1%} to {per_entry.max():.1%} by entry")
    assert 0.90 <= covered <= 0.99
    assert per_entry.min() >= 0.85


def test_the_model_written_beside_is_plain_yaml(folder, tmp_path):
    assert identify(folder, tmp_path) == 0
    plain = yaml.safe_load((tmp_path / "model_estimate.yaml").read_text())
    assert np.shape(plain["mass"]) == (3, 3)


@pytest.mark.parametrize(("masses", "remarks"), [(2, 1), (3, 0), (4, 1)])
def test_a_model_of_another_order_than_the_record_shows_is_remarked_on(folder, masses, remarks):
    record = read_record(folder / "run.mcap")
    model = Model(n=masses, input_map=np.eye(masses, 3), output_map=np.eye(3, masses))
    found = order_remarks(record, model)
    assert len(found) == remarks and all("shows 3 degrees of freedom" in text for text in found)
