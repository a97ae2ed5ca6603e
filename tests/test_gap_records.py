"""Records as they really come, through the gap door on files: handled, or refused with one clear message."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sysid_bench.__main__ import main
from sysid_bench.effects.cubic_stiffness import CubicStiffness
from sysid_bench.files import write_model
from sysid_bench.gap.colour import coloured
from sysid_bench.gap.workflow import find_gap
from sysid_bench.mechanics.nonlinear import simulate
from sysid_bench.nouns import LOST, InputError, Model, Plant, Record
from sysid_bench.records import write_record

sys.path.insert(0, str(Path(__file__).parents[1] / "experiments" / "hidden_effects"))

M, D, K = np.diag([0.8, 2.0, 1.2]), 0.1 * np.array([[4.0, -1, -1], [-1, 4, -1], [-1, -1, 4]]), None
K = 10 * D
H, N = 0.1, 3000


def recorded(
    seed, level=1.0, samples=N, forces=(0, 1, 2), sensors=(0, 1, 2), noise=0.01, output="displacement"
):
    """A record of the plant with a hardening spring on DOF 1."""
    from plants import excite

    rng = np.random.default_rng(seed)
    u = level * excite("noise", samples, H, len(forces), 1.0, 2.5, rng)
    plant = Plant(
        M, D, K, input_map=np.eye(3)[:, list(forces)], output_map=np.eye(3)[list(sensors)], output=output,
        effects=(CubicStiffness(1, 8.0),),
    )  # fmt: skip
    y = simulate(plant, u, H, "cubic").y
    return Record(np.arange(samples) * H, u, y + noise * rng.normal(size=y.shape), hold="cubic")


def model(forces=(0, 1, 2), sensors=(0, 1, 2)):
    maps = {"input_map": np.eye(3)[:, list(forces)], "output_map": np.eye(3)[list(sensors)]}
    return Model(M, D, K, hold="cubic", **maps)


def gap(folder, train, test, given=None, code=0):
    """gap.json of the door run on files."""
    names = {"train": [], "test": []}
    for kind, records in (("train", train), ("test", test)):
        for k, record in enumerate(records):
            write_record(record, folder / f"{kind}{k}.mcap")
            names[kind].append(str(folder / f"{kind}{k}.mcap"))
    write_model(given or model(), folder / "model.yaml")
    words = [f"{kind}={','.join(files)}" for kind, files in names.items()]
    words += [f"model={folder / 'model.yaml'}", f"out={folder / 'gap'}", "views=false", "recording=false"]
    assert main(["gap", *words, "power=false"]) == code
    return json.loads((folder / "gap" / "gap.json").read_text()) if code == 0 else None


def named(values):
    for effect in values["effects"]:  # std is there, null where a value was chosen or read off the data
        assert all(set(p) == {"value", "std", "unit"} for p in effect["parameters"].values())
    return [(e["name"], e["dof"]) for e in values["effects"]]


def flagged(record, share=0.02, how="nan"):
    lost = np.random.default_rng(0).random(record.N) < share
    y = np.where(lost[:, None], np.nan if how == "nan" else 0.0, record.y)
    u = np.where(lost[:, None], 0.0, record.u) if how == "blank" else record.u
    return replace(record, u=u, y=y, quality=np.where(lost, LOST, 0).astype(np.uint8))


@pytest.mark.parametrize("how", ["nan", "blank"])
def test_flagged_samples(tmp_path, how):
    values = gap(tmp_path, [flagged(recorded(1), how=how)], [flagged(recorded(2), how=how)])
    assert named(values) == [("cubic_stiffness", 1)]
    assert values["gap_after"] < (1.2 if how == "nan" else 2.0) * values["noise_floor"]
    assert any("flagged" in remark for remark in values["data"]["remarks"])


def test_time_stamps_with_holes(tmp_path):
    record = recorded(1)
    kept = np.random.default_rng(0).random(N) > 0.01
    holes = Record(record.t[kept], record.u[kept], record.y[kept], hold="cubic")
    assert named(gap(tmp_path, [holes], [recorded(2)])) == [("cubic_stiffness", 1)]


def test_unequal_lengths_and_amplitudes(tmp_path):
    train = [recorded(1), recorded(3, 0.3, N // 2), recorded(4, 2.0, N // 3)]
    values = gap(tmp_path, train, [recorded(2), recorded(5, 0.5, N // 2)])
    assert named(values) == [("cubic_stiffness", 1)]
    assert values["gap_after"] < 1.2 * values["noise_floor"] and len(values["tests"]) == 2
    assert (tmp_path / "gap" / "prediction_1.csv").is_file()


def test_sensors_on_some_degrees_of_freedom(tmp_path):
    some = {"sensors": (0, 2)}
    values = gap(tmp_path, [recorded(1, **some)], [recorded(2, **some)], model(**some))
    assert named(values) == [("cubic_stiffness", 1)]


@pytest.mark.parametrize("output", ["velocity", "acceleration"])
def test_velocity_and_acceleration(tmp_path, output):
    given = replace(model(), output=output)
    train, test = (recorded(seed, noise=0.1, output=output) for seed in (1, 2))
    values = gap(tmp_path, [train], [test], given)
    assert named(values) == [("cubic_stiffness", 1)]


def test_an_effect_of_the_model_with_a_wrong_size_is_a_wrong_parameter(tmp_path):
    given = replace(model(), effects=(CubicStiffness(1, 5.0),))
    values = gap(tmp_path, [recorded(1)], [recorded(2)], given)
    assert values["verdict"] == "parameters"
    moved = next(m for m in values["parameters_moved"] if m.get("effect") == "cubic_stiffness")
    assert (moved["dof"], moved["parameter"], moved["from"]) == (1, "stiffness", 5.0)
    assert abs(moved["to"] - 8.0) < 4 * moved["std"] < 1.0
    assert values["gap_after"] < 0.2 * values["gap_before"]


def test_forces_on_some_degrees_of_freedom(tmp_path):
    some = {"forces": (2,)}
    values = gap(tmp_path, [recorded(1, 3.0, **some)], [recorded(2, 3.0, **some)], model(**some))
    assert named(values) == [("cubic_stiffness", 1)]


def refused(folder, capsys, train, test, given=None):
    gap(folder, train, test, given, code=2)
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert "Traceback" not in message
    return message


def test_records_that_do_not_fit_are_refused(tmp_path, capsys):
    some = recorded(1, sensors=(0, 2))
    assert "3 input(s) and 2 output(s)" in refused(tmp_path, capsys, [some], [recorded(2)])
    assert "3 input(s) and 2 output(s)" in refused(tmp_path, capsys, [recorded(1)], [some])
    slower = replace(model(), sample_time_s=2 * H)
    assert "sample_time" in refused(tmp_path, capsys, [recorded(1)], [recorded(2)], slower)
    in_mm = replace(recorded(1), units={"y": ["mm"] * 3})
    metres = replace(model(), units={"y": ["m"] * 3})
    assert "units of y1 disagree" in refused(tmp_path, capsys, [in_mm], [recorded(2)], metres)
    few = flagged(recorded(1), share=0.999)
    assert "too few" in refused(tmp_path, capsys, [few], [recorded(2)])


def test_a_file_where_the_folder_is_wanted_is_refused_before_the_work(tmp_path, capsys):
    (tmp_path / "gap").write_text("")
    message = refused(tmp_path, capsys, [recorded(1)], [recorded(2)])
    assert "a folder is wanted" in message and "[" not in message


@pytest.mark.parametrize("phi", [0.0, 0.6, 0.8])
def test_the_colour_of_noise_is_told(phi):
    from scipy.signal import lfilter

    rng = np.random.default_rng(4)
    e = lfilter([np.sqrt(1 - phi**2)], [1, -phi], rng.normal(size=8000))
    found = coloured(np.abs(np.fft.rfft(e)) ** 2 / len(e))
    assert (found is None) == (phi == 0)
    if found:
        assert found[0] == pytest.approx(1.0, rel=0.15) and found[1] == pytest.approx(phi, abs=0.04)


def test_a_strong_colour_is_told_by_the_frequencies_of_the_plant_too():
    """A slope far up hardly tells phi = .94: the variance that it alone gives is off by half and more."""
    from scipy.signal import lfilter

    def told(seed: int) -> tuple[float, float]:
        e = lfilter([np.sqrt(1 - 0.94**2)], [1, -0.94], np.random.default_rng(seed).normal(size=6000))
        found = coloured(np.abs(np.fft.rfft(e * np.hanning(6000))) ** 2 / 6000 / 0.375, lowest=0.3)
        assert found is not None
        return found

    variance, phi = np.transpose([told(seed) for seed in range(10)])
    assert np.sqrt(np.mean(np.log(variance) ** 2)) < 0.35 and np.median(phi) == pytest.approx(0.94, abs=0.02)


def test_white_noise_under_a_response_stays_white():
    omega = np.linspace(1e-3, np.pi, 4000)
    exponential = np.random.default_rng(0).exponential(size=len(omega))
    assert coloured(exponential * (1e-3 / (0.01 + omega**2) + 1), lowest=0.3) is None


def test_a_response_that_falls_off_is_no_noise():
    omega = np.linspace(1e-3, np.pi, 4000)
    exponential = np.random.default_rng(0).exponential(size=len(omega))
    assert coloured(exponential / (0.01 + omega**4)) is None


def test_coloured_noise_makes_no_effect(tmp_path):
    from scipy.signal import lfilter

    records = []
    for seed in (1, 2):
        clean = recorded(seed, noise=0.0)
        linear = simulate(Plant(M, D, K), clean.u, H, "cubic").y
        e = lfilter([0.6], [1, -0.8], np.random.default_rng(seed + 9).normal(size=linear.shape), axis=0)
        records.append(replace(clean, y=linear + 0.03 * e))
    values = gap(tmp_path, records[:1], records[1:])
    assert values["verdict"] == "none" and not values["effects"]


def test_times_in_milliseconds_are_refused_by_what_they_would_mean():
    u = np.random.default_rng(0).standard_normal((400, 1))
    record = Record(100.0 * np.arange(400), u, u)  # ms taken for s
    with pytest.raises(InputError, match=r"above half the record's sampling rate.*times in seconds"):
        find_gap([record], [record], Model([[1.0]], [[0.1]], [[1.0]], hold="zoh"))
