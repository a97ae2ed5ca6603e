"""The gap workflow end to end, on records from the trials' own engine."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sysid_bench.gap.workflow import find_gap
from sysid_bench.nouns import InputError, Model, Record

TRIALS = Path(__file__).parents[1] / "experiments" / "hidden_effects"


@pytest.fixture(scope="module")
def draw():
    sys.path.insert(0, str(TRIALS))
    import draw

    yield draw.Draw
    sys.path.remove(str(TRIALS))


def case(draw, seed, **given):
    trial = draw(seed, size="one", **given).trial()
    model = Model(
        trial.M, trial.D, trial.K, input_map=trial.L, hold=trial.hold, initial_state=trial.initial_state
    )
    records = [
        Record(np.arange(len(u)) * trial.h, u, y, hold=trial.hold) for u, y in (trial.train, trial.test)
    ]
    return records, model, trial.truth


@pytest.mark.parametrize("name", ["coulomb_friction", "cubic_stiffness", "end_stop", "actuator_lag"])
def test_a_single_effect_is_named_and_the_gap_closes(draw, name):
    records, model, truth = case(draw, 12, kind="single", name=name)
    answer = find_gap(records[:1], records[1:], model)
    assert answer.verdict.word == "effect"
    assert [(e.name, e.dof) for e in answer.added] == [(x["name"], x["dof"]) for x in truth["effects"]]
    assert answer.gap_after < min(1.1 * answer.floor, answer.gap_before)


def test_nothing_missing_is_said_so(draw):
    records, model, _ = case(draw, 21, kind="none")
    answer = find_gap(records[:1], records[1:], model)
    assert answer.verdict.word == "none" and not answer.added


def test_wrong_parameters_are_said_so_and_put_right(draw):
    records, model, _ = case(draw, 22, kind="parameters")
    answer = find_gap(records[:1], records[1:], model)
    assert answer.verdict.word == "parameters"
    assert answer.gap_after < 1.1 * answer.floor


def test_a_better_model_that_is_worse_on_the_test_records_is_said_so(draw):
    records, model, _ = case(draw, 12, kind="single", name="cubic_stiffness")
    answer = find_gap(records[:1], records[1:], model)
    assert "grew" not in answer.reason
    worse = replace(answer, before=answer.after, after=answer.before)
    assert worse.reason.startswith(answer.verdict.reason) and "the gap grew from" in worse.reason


def test_lost_samples_change_nothing(draw):
    records, model, _ = case(draw, 12, kind="single", name="cubic_stiffness")
    lost = np.random.default_rng(0).random(records[0].N) < 0.02
    quality = lost.astype(np.uint8)
    flagged = Record(
        records[0].t, records[0].u, np.where(lost[:, None], 0.0, records[0].y), records[0].hold, quality
    )
    answer = find_gap([flagged], records[1:], model)
    assert [e.name for e in answer.added] == ["cubic_stiffness"]


def test_a_record_of_other_width_is_refused(draw):
    records, _, _ = case(draw, 12, kind="none")
    two = Model(np.eye(2), np.eye(2), np.eye(2))
    with pytest.raises(InputError, match="2 input"):
        find_gap(records[:1], records[1:], two)


def test_the_door_writes_what_is_promised(draw, tmp_path):
    from sysid_bench.__main__ import main
    from sysid_bench.files import read_model

    trial = draw(12, size="one", kind="single", name="cubic_stiffness").trial()
    sys.modules["draw"].write(trial, tmp_path)
    out = tmp_path / "gap"
    words = [f"{x}={tmp_path / x}.csv" for x in ("train", "test")]
    assert main(["gap", *words, f"model={tmp_path / 'model.yaml'}", f"out={out}"]) == 0
    values = json.loads((out / "gap.json").read_text())
    assert values["verdict"] == "effect" and values["effects"][0]["name"] == "cubic_stiffness"
    assert values["gap_after"] < values["gap_before"]
    table = np.loadtxt(out / "prediction.csv", delimiter=",", skiprows=1)
    assert table.shape == (len(trial.test[0]), 2)
    y = trial.test[1][:, 0]
    assert np.sqrt(np.mean((y - table[:, 1]) ** 2) / np.mean(y**2)) == pytest.approx(
        values["gap_after"], rel=1e-6
    )
    assert [e.name for e in read_model(out / "model.yaml").effects] == ["cubic_stiffness"]


OWN = '''
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import At, Effect, Knob


@dataclass(frozen=True)
class MagneticDetent(Effect):
    """strength * x * exp(-(x / reach)^2)"""

    name: ClassVar[str] = "magnetic_detent"
    knobs: ClassVar[dict[str, Knob]] = {"strength": Knob("N/m"), "reach": Knob("m", (1e-6, 10.0))}

    dof: int | tuple[int, int] | None = 0
    strength: float = 1.0
    reach: float = 0.5

    def law(self, at: At, p):
        return p.strength * at.x * ca.exp(-((at.x / p.reach) ** 2)), []
'''


def test_an_effect_of_the_users_own_takes_part(tmp_path):
    from sysid_bench.effects import own_effect
    from sysid_bench.mechanics.nonlinear import simulate
    from sysid_bench.nouns import Plant

    (tmp_path / "detent.py").write_text(OWN)
    kind = own_effect(tmp_path / "detent.py")
    rng = np.random.default_rng(3)
    truth = Plant([[1.0]], [[0.3]], [[1.0]], effects=(kind(strength=0.8, reach=0.6),))
    records = []
    for _ in range(2):
        u = np.repeat(rng.normal(size=(600, 1)), 10, axis=0)
        y = simulate(truth, u, 0.05, "zoh").y
        records.append(Record(np.arange(len(u)) * 0.05, u, y + 0.01 * rng.normal(size=y.shape), hold="zoh"))
    answer = find_gap(records[:1], records[1:], Model([[1.0]], [[0.3]], [[1.0]], hold="zoh"), own=(kind,))
    assert [e.name for e in answer.added] == ["magnetic_detent"]
    assert answer.added[0].strength == pytest.approx(0.8, rel=0.1)
    assert answer.added[0].reach == pytest.approx(0.6, rel=0.1)
