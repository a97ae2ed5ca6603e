"""simulate and export from the command line: what they write, what they say, what they refuse."""

from __future__ import annotations

import json
import runpy
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from scipy.io import loadmat

from sysid_bench import effects
from sysid_bench.__main__ import main
from sysid_bench.exports import mjcf
from sysid_bench.files import read_model, write_estimate, write_model
from sysid_bench.files.effects import effect_from, entry_of
from sysid_bench.nouns import Estimate, Model
from sysid_bench.records import read_record
from sysid_bench.records.mcap_read import read_attachments

M = np.array([[2.0, 0.1], [0.1, 1.0]])
D = np.array([[0.3, -0.1], [-0.1, 0.1]])
K = np.array([[5.0, -1.0], [-1.0, 3.0]])
MAPS = Model(n=2, input_map=[[1.0], [0.5]], output_map=[[0.0, 1.0]], output="velocity", hold="cubic")


def run(*words: str) -> int:
    return main([str(word) for word in words])


def refused(capsys, *words: str) -> str:
    capsys.readouterr()
    assert run(*words) == 2
    message = capsys.readouterr().err.strip()
    assert "\n" not in message and "Traceback" not in message
    return message


@pytest.mark.parametrize("suffix", [".mcap", ".csv", ".parquet"])
def test_simulate_writes_a_record_of_each_kind(tmp_path, capsys, suffix):
    out = tmp_path / f"run{suffix}"
    assert (
        run("simulate", "plant=three_dof", "noise.snr_db=15", "sampling.N=300", "seed=5", f"out={out}") == 0
    )
    said = capsys.readouterr()
    record = read_record(out)
    assert (record.N, record.nu, record.ny, record.h) == (300, 3, 3, pytest.approx(0.1))
    assert said.out.strip() == f"{out}: Record(300 samples at 0.1 s, nu=3, ny=3, hold=cubic, simulated)"
    if suffix == ".csv":
        assert "input_intersample: smooth" in said.err
    else:
        assert record.hold == "cubic"
        assert record.origin["config"]["noise"]["snr_db"] == 15.0
        assert record.origin["seed"] == 5


def test_the_same_seed_gives_the_same_samples_in_every_file(tmp_path):
    for name, seed in (("a.mcap", 1), ("b.csv", 1), ("c.parquet", 2)):
        assert run("simulate", "sampling.N=200", f"seed={seed}", f"out={tmp_path / name}") == 0
    a, b, c = (read_record(tmp_path / name) for name in ("a.mcap", "b.csv", "c.parquet"))
    assert np.array_equal(a.y, b.y) and np.array_equal(a.u, b.u)
    assert not np.array_equal(a.y, c.y)


def test_an_mcap_carries_the_config_that_made_it(tmp_path):
    assert run("simulate", "sampling.N=50", f"out={tmp_path / 'a.mcap'}") == 0
    text = read_attachments(tmp_path / "a.mcap")["config.yaml"].decode()
    assert "knot_spacing_s: 1.0" in text and "N: 50" in text


def test_simulate_takes_a_model_file(tmp_path, capsys):
    write_model(Model(M, D, K, input_map=[[1.0], [0.0]], output_map=[[0.0, 1.0]]), tmp_path / "model.yaml")
    words = ("simulate", f"model={tmp_path / 'model.yaml'}", "sampling.N=100", "noise.snr_db=300")
    assert run(*words, f"out={tmp_path / 'a.mcap'}") == 0
    linear = read_record(tmp_path / "a.mcap")
    assert (linear.nu, linear.ny) == (1, 1)
    assert list(linear.origin["inputs"]) == [str(tmp_path / "model.yaml")]
    friction = "effects=[{name: coulomb_friction, dof: 0, parameters: {force: {value: 0.5, unit: N}}}]"
    assert run(*words, friction, f"out={tmp_path / 'b.mcap'}") == 0
    assert np.std(read_record(tmp_path / "b.mcap").y) < 0.9 * np.std(linear.y), "friction brakes"


def test_what_simulate_refuses(tmp_path, capsys):
    out = f"out={tmp_path / 'a.mcap'}"
    model = tmp_path / "model.yaml"
    assert ".mcap, .csv, .parquet" in refused(capsys, "simulate", "out=a.xls")
    assert "needs out" in refused(capsys, "simulate")
    assert "three_dof" in refused(capsys, "simulate", "plant=foo", out)
    assert "no file" in refused(capsys, "simulate", f"model={model}", out)
    write_model(Model(n=2), model)
    assert "mass, damping and stiffness are wanted" in refused(capsys, "simulate", f"model={model}", out)
    write_model(Model(M, D, K, sample_time_s=0.01), model)
    assert "sampling.h_s=0.01" in refused(capsys, "simulate", f"model={model}", out)
    assert "seed" in refused(capsys, "simulate", "seed=-1", out)
    assert "whole number" in refused(capsys, "simulate", "seed=1.5", out)
    assert "coulomb_friction" in refused(capsys, "simulate", "effects=[{name: stiction, dof: 0}]", out)
    assert "knot_spacing_s" in refused(capsys, "simulate", "sampling.h_s=0.3", out)
    assert "must be square" in refused(capsys, "simulate", "plant.mass=[[1,0]]", out)
    assert "symmetric" in refused(capsys, "simulate", "plant.stiffness=[[1,2,0],[0,1,0],[0,0,1]]", out)
    assert "positive definite" in refused(capsys, "simulate", "plant.mass=[[0,0,0],[0,0,0],[0,0,0]]", out)
    assert not (tmp_path / "a.mcap").exists()


@pytest.mark.parametrize("name", effects.names())
def test_every_effect_goes_through_a_model_file(tmp_path, name):
    kind = effects.effect_class(name)
    effect = kind()
    model = Model(M, D, K, effects=(effect,))
    write_model(model, tmp_path / "model.yaml")
    back = read_model(tmp_path / "model.yaml").effects
    assert [(type(e), entry_of(e)) for e in back] == [(kind, entry_of(effect))]


def test_effects_of_a_model_file_that_are_wrong():
    good = {"name": "coulomb_friction", "dof": 0, "parameters": {"force": 0.5}}
    assert effect_from(good, "effects[0]").force == 0.5
    for change, words in (
        ({"name": "stiction"}, "coulomb_friction"),
        ({"dof": 1.5}, "dof"),
        ({"dof": [0, 1, 2]}, "pair"),
        ({"dof": -1}, "dof"),
        ({"parameters": {"froce": 1.0}}, "force"),
        ({"parameters": {"force": {"value": 1.0, "unit": "kN"}}}, "'N'"),
        ({"parameters": {"force": {"value": "much"}}}, "force"),
        ({"parameters": {"force": {"value": -1.0}}}, "force"),
        ({"parameters": {"force": {"val": 1.0}}}, "{value, unit}"),
        ({"parameters": [1]}, "mapping"),
        ({"place": 1}, "'place'"),
    ):
        with pytest.raises(ValueError) as caught:
            effect_from(good | change, "effects[0]")
        assert "effects[0]" in str(caught.value) and words in str(caught.value)


@pytest.fixture
def estimate(tmp_path) -> Path:
    path = tmp_path / "estimate.json"
    value = Estimate(M, D, K, covariance=np.eye(9) * 0.01, poles=np.array([-0.1 + 1j, -0.1 - 1j]))
    write_estimate(value, path, method="variational_pem", model=MAPS)
    return path


def acceleration(u: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.linalg.solve(M, MAPS.input_map[:, 0] * u - D @ v - K @ q)


def test_export_to_model_yaml(tmp_path, estimate, capsys):
    assert run("export", f"estimate={estimate}", f"to={tmp_path / 'model.yaml'}") == 0
    assert "does not keep: standard errors" in capsys.readouterr().err
    model = read_model(tmp_path / "model.yaml")
    assert np.array_equal(model.stiffness, K) and np.array_equal(model.output_map, MAPS.output_map)
    assert (model.output, model.hold) == ("velocity", "cubic")


def test_export_to_matlab(tmp_path, estimate):
    assert run("export", f"estimate={estimate}", f"to={tmp_path / 'e.mat'}") == 0
    found = loadmat(tmp_path / "e.mat")
    assert np.array_equal(found["M"], M) and np.allclose(found["K_std"], 0.1)
    assert np.allclose(found["Ass"][2:] @ [1, 2, 3, 4], acceleration(0.0, np.array([1, 2]), np.array([3, 4])))


def test_export_to_python_control(tmp_path, estimate):
    assert run("export", f"estimate={estimate}", f"to={tmp_path / 'system.py'}") == 0
    system = runpy.run_path(str(tmp_path / "system.py"))["system"]
    assert system.dt == 0
    s = 0.7j
    wanted = s * MAPS.output_map @ np.linalg.solve(s * s * M + s * D + K, MAPS.input_map)
    assert system(s) == pytest.approx(wanted[0, 0], rel=1e-12)
    assert run("export", f"estimate={estimate}", f"to={tmp_path / 'system.json'}") == 0
    assert np.array_equal(json.loads((tmp_path / "system.json").read_text())["A"], system.A)


def test_a_black_box_estimate_is_exported_as_it_is(tmp_path, capsys):
    path = tmp_path / "estimate.json"
    matrices = (np.array([[0.9]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)), 0.1)
    write_estimate(Estimate(state_space=matrices), path, method="n4sid", model=MAPS)
    assert run("export", f"estimate={path}", f"to={tmp_path / 's.py'}") == 0
    assert runpy.run_path(str(tmp_path / "s.py"))["system"].dt == 0.1
    assert "no M, D, K" in refused(capsys, "export", f"estimate={path}", f"to={tmp_path / 's.xml'}")


def assembled(root: ET.Element, n: int) -> dict[str, np.ndarray]:
    """M, D, K that MuJoCo makes of the joints and fixed tendons (its documentation, XML reference)."""
    joints = {joint.get("name"): joint for joint in root.iter("joint") if joint.get("name")}
    bodies = [float(i.get("mass")) for i in root.iter("inertial")]
    of = {
        name: np.array([float(joint.get(name)) for joint in joints.values()])
        for name in ("armature", "damping", "stiffness")
    }
    nested = len(root.find("worldbody").findall("body")) == 1
    chain = np.tril(np.ones((n, n))) if nested else np.eye(n)  # a body moves with the joints above it
    found = {"armature": chain.T @ np.diag(bodies) @ chain + np.diag(of["armature"])}
    found |= {name: np.diag(of[name]) for name in ("damping", "stiffness")}
    for tendon in root.iter("fixed"):
        c = np.zeros(n)
        for part in tendon.iter("joint"):
            c[int(part.get("joint")[1:]) - 1] = float(part.get("coef"))
        for name, matrix in found.items():
            coupling = float(tendon.get(name, 0)) * np.outer(c, c)
            matrix += coupling if name != "armature" or nested else np.diag(np.diag(coupling))
    return found


def random_positive(rng: np.random.Generator, n: int) -> np.ndarray:
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


@pytest.mark.parametrize("seed", range(5))
def test_mjcf_says_exactly_the_estimated_matrices(seed):
    rng = np.random.default_rng(seed)
    n = seed + 1
    mass = np.diag(rng.uniform(1, 2, n)) if seed % 2 else random_positive(rng, n)
    model = Model(mass, random_positive(rng, n), random_positive(rng, n))
    found = assembled(mjcf.mjcf(model, "e"), n)
    for name, wanted in (
        ("armature", model.mass),
        ("damping", model.damping),
        ("stiffness", model.stiffness),
    ):
        assert np.allclose(found[name], wanted, rtol=1e-9, atol=1e-12)


def test_mujoco_moves_as_the_estimate_says(tmp_path, estimate):
    mujoco = pytest.importorskip("mujoco")
    assert run("export", f"estimate={estimate}", f"to={tmp_path / 'm.xml'}") == 0
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "m.xml"))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = [0.3, -0.2], [1.0, 2.0], [0.7]
    mujoco.mj_forward(model, data)
    assert np.allclose(data.qacc, acceleration(0.7, data.qpos, data.qvel), rtol=1e-9)
    assert data.sensordata == pytest.approx([2.0])


def test_mjcf_is_exact_or_refused(tmp_path, estimate, capsys):
    assert run("export", f"estimate={estimate}", f"to={tmp_path / 'm.xml'}") == 0
    assert "standard errors" in capsys.readouterr().err
    bad = json.loads(estimate.read_text())
    bad["D"]["value"] = [[-0.1, 0.0], [0.0, 0.1]]
    (tmp_path / "bad.json").write_text(json.dumps(bad))
    message = refused(capsys, "export", f"estimate={tmp_path / 'bad.json'}", f"to={tmp_path / 'bad.xml'}")
    assert "damping has eigenvalue -0.1" in message
    assert not (tmp_path / "bad.xml").exists()


def test_what_export_refuses(tmp_path, estimate, capsys):
    assert ".yaml, .mat, .xml" in refused(capsys, "export", f"estimate={estimate}", "to=a.urdf")
    assert "estimate itself" in refused(capsys, "export", f"estimate={estimate}", f"to={estimate}")
    assert "no file" in refused(capsys, "export", "estimate=absent.json", "to=a.mat")
    failed = tmp_path / "failed.json"
    write_estimate(Estimate(status="diverged", reason="no step"), failed, method="x")
    for name in ("a.yaml", "a.xml", "a.mat", "a.py"):
        assert "diverged" in refused(capsys, "export", f"estimate={failed}", f"to={tmp_path / name}")
