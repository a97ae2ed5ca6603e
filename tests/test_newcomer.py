"""What a newcomer types: odd paths, words where numbers belong, wrong inputs that must leave nothing behind."""

from __future__ import annotations

import numpy as np
import pytest

from sysid_bench.__main__ import main
from sysid_bench.files import write_model
from sysid_bench.nouns import Model, Record
from sysid_bench.records import read_record, write_record


@pytest.fixture
def model(tmp_path):
    write_model(Model(np.eye(1), np.eye(1), np.eye(1), hold="zoh"), tmp_path / "model.yaml")
    return tmp_path / "model.yaml"


@pytest.mark.parametrize("content", ["", "t,u1,y1\n0,1,nan\n0.1,1,2\n"])
def test_a_wrong_record_leaves_no_folder(tmp_path, capsys, model, content):
    (tmp_path / "run.csv").write_text(content)
    words = [f"record={tmp_path / 'run.csv'}", f"model={model}", f"out={tmp_path / 'out'}"]
    assert main(["identify", *words]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_path_without_its_key_may_hold_anything(tmp_path, capsys):
    path = tmp_path / "r\u00fcn a = 1, [b].mcap"
    t = 0.1 * np.arange(30)
    write_record(Record(t, np.sin(t)[:, None], np.cos(t)[:, None]), path)
    picture = tmp_path / "a=1, b.rrd"
    assert main(["view", str(path), f"out={picture}"]) == 0, capsys.readouterr().err
    assert picture.stat().st_size > 0
    assert main(["recover", str(path), f"out={tmp_path / 'again.mcap'}"]) == 0, capsys.readouterr().err
    assert read_record(tmp_path / "again.mcap").N == 30


@pytest.mark.parametrize(
    "word", ["study.repetitions=abc", "study.repetitions=1.5", "study.seed=x", "study.name=[a]"]
)
def test_a_study_of_the_wrong_kind_is_one_message(tmp_path, capsys, word):
    code = main(["sweep", "plant=one_dof", f"results_dir={tmp_path / 'results'}", word])
    said = capsys.readouterr().err
    assert code == 2 and said.count("\n") == 1 and word.split("=")[0].split(".")[1] in said
    assert not (tmp_path / "results").exists()
