"""Where no name fits: nothing is added, and what the rest is like is said."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from sysid_bench.__main__ import main
from sysid_bench.files import read_model

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "experiments" / "hidden_effects"
GAP_JSON = (ROOT / "docs" / "files.md").read_text().partition("## gap.json\n")[2].partition("\n## ")[0]


@pytest.fixture(scope="module", autouse=True)
def path():
    sys.path.insert(0, str(FOLDER))
    yield
    sys.path.remove(str(FOLDER))


@pytest.mark.parametrize("name, of_state", [("van_der_pol", True), ("random_force", False)])
def test_an_unnamed_force_is_described_and_not_added(tmp_path, name, of_state):
    from draw import Draw
    from trial import write

    write(Draw(5, kind="unknown", name=name, size="three").trial(), tmp_path)
    words = [f"{k}={tmp_path / k}.csv" for k in ("train", "test")]
    words += [f"model={tmp_path / 'model.yaml'}", f"out={tmp_path / 'gap'}", "recording=false", "power=false"]
    assert main(["gap", *words]) == 0
    values = json.loads((tmp_path / "gap" / "gap.json").read_text())
    assert values["verdict"] == "unknown" and values["effects"] == []
    assert not [key for key in values if f"`{key}`" not in GAP_JSON], (
        "a key that docs/files.md does not explain"
    )
    assert not read_model(tmp_path / "gap" / "model.yaml").effects
    table = np.loadtxt(tmp_path / "gap" / "prediction.csv", delimiter=",", skiprows=1)
    y = np.loadtxt(tmp_path / "test.csv", delimiter=",", skiprows=1)[:, -3:]
    gap = np.sqrt(np.mean(np.mean((y - table[:, 1:]) ** 2, axis=0) / np.mean(y**2, axis=0)))
    assert gap == pytest.approx(values["gap_after"], rel=1e-6)
    best = values["description"]["flexible_reference"][0]
    assert best["any_force"] > 0.8
    assert (best["force_of_the_state"] > 0.6) == of_state
    assert "could be explained at all" in (tmp_path / "gap" / "report.html").read_text()
