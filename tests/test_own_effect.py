"""An effect of the user's own: named by gap, written to model.yaml, read back by every door that takes the model."""

from __future__ import annotations

import json
import secrets

import numpy as np
import pytest

from sysid_bench.__main__ import main
from sysid_bench.effects import own_effect
from sysid_bench.files import read_model, write_model
from sysid_bench.mechanics.nonlinear import simulate
from sysid_bench.nouns import InputError, Model, Plant, Record
from sysid_bench.records import read_record, write_record

OWN = '''
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import At, Effect, Knob


@dataclass(frozen=True)
class MagneticDetent(Effect):
    """strength * x * exp(-(x / reach)^2)"""

    name: ClassVar[str] = "magnetic_detent"
    equation: ClassVar[str] = "strength * x * exp(-(x / reach)^2)"
    knobs: ClassVar[dict[str, Knob]] = {"strength": Knob("N/m"), "reach": Knob("m", (1e-6, 10.0))}

    dof: int | tuple[int, int] | None = 0
    strength: float = 1.0
    reach: float = 0.5

    def law(self, at: At, p):
        return p.strength * at.x * ca.exp(-((at.x / p.reach) ** 2)), []
'''


@pytest.fixture(scope="module")
def answered(tmp_path_factory):
    """A folder with detent.py, records of a plant with the detent, and what gap made of them in gap/."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "detent.py").write_text(OWN)
    kind, rng = own_effect(folder / "detent.py"), np.random.default_rng(3)
    truth = Plant([[1.0]], [[0.3]], [[1.0]], effects=(kind(strength=0.8, reach=0.6),))
    for name in ("train", "test"):
        u = np.repeat(rng.normal(size=(400, 1)), 10, axis=0)
        y = simulate(truth, u, 0.05, "zoh").y
        y = y + 0.01 * rng.normal(size=y.shape)
        write_record(Record(np.arange(len(u)) * 0.05, u, y, hold="zoh"), folder / f"{name}.mcap")
    write_model(Model([[1.0]], [[0.3]], [[1.0]], hold="zoh"), folder / "model.yaml")
    assert gap(folder, "model.yaml", "gap", "detent.py") == 0
    return folder


def gap(folder, model, out, own):
    words = [f"{name}={folder / name}.mcap" for name in ("train", "test")]
    words += [f"model={folder / model}", f"out={folder / out}", "views=false", "recording=false"]
    return main(["gap", *words, f"effects_path={folder / own}"])


def test_it_is_named_and_its_model_file_is_read_back(answered):
    values = json.loads((answered / "gap" / "gap.json").read_text())
    assert [e["name"] for e in values["effects"]] == ["magnetic_detent"]
    (effect,) = read_model(answered / "gap" / "model.yaml", (own_effect(answered / "detent.py"),)).effects
    assert effect.strength == pytest.approx(0.8, rel=0.1) and effect.reach == pytest.approx(0.6, rel=0.1)


def test_the_gap_is_closed_for_gap_itself(answered):
    assert gap(answered, "gap/model.yaml", "again", "detent.py") == 0
    values = json.loads((answered / "again" / "gap.json").read_text())
    assert values["verdict"] == "none"
    assert values["gap_before"] < 1.1 * values["noise_floor"]


def test_simulate_takes_the_model_with_its_effect(answered, capsys):
    words = [
        f"model={answered / 'gap' / 'model.yaml'}",
        "excitation=prbs",
        "sampling.h_s=0.05",
        "sampling.N=400",
    ]
    words += ["noise=none", f"out={answered / 'run.mcap'}"]
    assert main(["simulate", *words]) == 2
    message = capsys.readouterr().err
    assert "magnetic_detent" in message and "effects_path=FILE" in message and "Traceback" not in message
    assert main(["simulate", *words, f"effects_path={answered / 'detent.py'}"]) == 0
    record = read_record(answered / "run.mcap")
    kind = own_effect(answered / "detent.py")
    model = read_model(answered / "gap" / "model.yaml", (kind,))
    plant = Plant(model.mass, model.damping, model.stiffness, effects=model.effects)
    y = simulate(plant, record.u, 0.05, "zoh").y
    assert np.allclose(record.y, y, atol=1e-3 * np.abs(y).max())


def test_the_emulator_and_the_preview_of_a_run_take_it(answered, capsys):
    model = f"model={answered / 'gap' / 'model.yaml'}"
    words = ["rig=second_order_1", f"bus.port={20000 + secrets.randbelow(40000)}", model]
    own = f"effects_path={answered / 'detent.py'}"
    dry = ["dry_run=true", "excitation=multisine", "excitation.f_max_hz=1", f"out={answered / 'dry.mcap'}"]
    assert main(["measure", *words, *dry]) == 2 and "effects_path=FILE" in capsys.readouterr().err
    assert main(["measure", *words, own, *dry]) == 0
    assert main(["emulate", *words, "seconds=0.2"]) == 2
    assert "effects_path=FILE" in capsys.readouterr().err
    assert main(["emulate", *words, own, "seconds=0.2"]) == 0
    assert "1 degrees of freedom" in capsys.readouterr().out


def test_a_file_without_an_effect_is_one_message(answered, tmp_path):
    (tmp_path / "empty.py").write_text("x = 1\n")
    for name in ("empty.py", "absent.py"):
        with pytest.raises(InputError, match="Effect class"):
            own_effect(tmp_path / name)
