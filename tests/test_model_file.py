"""model.yaml: reads what users write, writes what it reads, and names what is wrong with its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sysid_bench.files import read_model, write_model
from sysid_bench.files.model import INTERSAMPLE, KEYS
from sysid_bench.nouns import OUTPUTS, InputError, Model

FULL = """\
# a crane
mass: [[2, 0], [0, 1.5e-1]]
damping:
  - [0.2, -1e-3]
  - [-1e-3, 0.1]
stiffness: [[20.0, -5], [-5, 5]]
input_map: [[1], [0]]
output_map: [[0, 1]]
output: velocity
input_intersample: smooth
initial_state: at_rest
sample_time: 1e-2
units: {t: s, u: [N], y: [m/s]}
free:
  damping: [[true, false], [false, true]]
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "model.yaml"
    path.write_text(text)
    return path


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_model(path)
    message = str(caught.value)
    assert str(path) in message and "\n" not in message and len(message) < 600
    return message


def assert_same(a: Model, b: Model) -> None:
    for name in ("mass", "damping", "stiffness", "input_map", "output_map"):
        one, other = getattr(a, name), getattr(b, name)
        assert (one is None) == (other is None)
        assert one is None or one.tobytes() == other.tobytes(), name
    for name in ("n", "output", "hold", "initial_state", "effects", "sample_time_s"):
        assert getattr(a, name) == getattr(b, name), name
    assert dict(a.units) == dict(b.units)
    assert {k: v.tolist() for k, v in a.free.items()} == {k: v.tolist() for k, v in b.free.items()}


def test_reads_what_a_user_writes(tmp_path):
    model = read_model(written(tmp_path, FULL))
    assert model.mass.tolist() == [[2.0, 0.0], [0.0, 0.15]]
    assert model.damping[0, 1] == -1e-3, "1e-3 is a number"
    assert (model.n, model.nu, model.ny) == (2, 1, 1)
    assert (model.output, model.hold, model.initial_state) == ("velocity", "cubic", "at_rest")
    assert model.sample_time_s == 0.01
    assert model.units == {"t": "s", "u": ["N"], "y": ["m/s"]}
    assert model.free["damping"].tolist() == [[True, False], [False, True]]


def test_the_least_that_is_wanted(tmp_path):
    model = read_model(written(tmp_path, "mass: 1.5\ndamping: 0\nstiffness: [[4]]\n"))
    assert (model.mass.tolist(), model.damping.tolist()) == ([[1.5]], [[0.0]])
    assert (model.hold, model.initial_state, model.output) == (None, "free", "displacement")
    structure = read_model(written(tmp_path, "degrees_of_freedom: 3\ninput_intersample: zoh\n"))
    assert (structure.n, structure.has_values, structure.hold) == (3, False, "zoh")


WRONG = [
    ("mass: 1\nmas: 2\n", ("line 2", "unknown key 'mas'", ", ".join(KEYS))),
    ("mass: [[1, 2], [3]]\ndamping: 0\nstiffness: 0\n", ("line 1", "mass[1]", "2 numbers")),
    ("mass: [1, 2]\ndamping: 0\nstiffness: 0\n", ("line 1", "nested list", "all its rows")),
    ("mass: [[1, 2]]\n", ("line 1", "square", "1 rows of 2")),
    ("mass: [[1, .nan], [0, 1]]\n", ("line 1", "mass[0][1]", "finite")),
    ("mass: [[1, one], [0, 1]]\n", ("mass[0][1]", "'one'")),
    ("mass: [[true]]\n", ("mass[0][0]", "True")),
    ("mass: 1\ndamping: 1\n", ("stiffness missing", "wanted together")),
    ("output: velocity\n", ("mass, damping and stiffness are wanted", "degrees_of_freedom")),
    ("mass: 0\ndamping: 0\nstiffness: 1\n", ("positive definite",)),
    ("mass: [[1, 1], [1, 1]]\ndamping: [[0, 0], [0, 0]]\nstiffness: [[1, 0], [0, 1]]\n", ("positive definite",)),
    ("mass: [[1, 0], [0, 1]]\ndamping: [[0, 0], [0, 0]]\nstiffness: [[1, 2], [0, 1]]\n", ("stiffness must be symmetric", "[0][1]")),
    ("mass: [[1, 0], [0, 1]]\ndamping: 1\nstiffness: 1\n", ("damping", "(2, 2)")),
    ("mass: 1\ndamping: 0\nstiffness: 1\ninput_map: [1, 0]\n", ("line 4", "[[1, 0]]", "[[1], [0]]")),
    ("mass: 1\ndamping: 0\nstiffness: 1\ninput_map: [[1], [0]]\n", ("input_map must have 1 rows",)),
    ("mass: 1\ndamping: 0\nstiffness: 1\noutput: force\n", ("line 4", *OUTPUTS, "'force'")),
    ("mass: 1\ndamping: 0\nstiffness: 1\ninput_intersample: cubic\n", ("line 4", *INTERSAMPLE)),
    ("mass: 1\ndamping: 0\nstiffness: 1\ninitial_state: zero\n", ("at_rest, free", "'zero'")),
    ("mass: 1\ndamping: 0\nstiffness: 1\nsample_time: 0\n", ("positive", "seconds")),
    ("mass: 1\ndamping: 0\nstiffness: 1\nfree: {mass: [[yes, no]]}\n", ("free.mass", "true and false")),
    ("mass: 1\ndamping: 0\nstiffness: 1\nunits: 3\n", ("units must be SI or a mapping",)),
    ("mass: 1\ndamping: 0\nstiffness: 1\neffects: {name: x}\n", ("effects must be a list",)),
    ("mass: 1\ndamping: 0\nstiffness: 1\neffects: [{nam: x}]\n", ("effects[0]", "'nam'", "name, dof")),
    ("mass: 1\ndamping: 0\nstiffness: 1\neffects: [{name: coulomb_friction, dof: 1}]\n", ("effects[0]", "dof 1", "0..0")),
    ("mass: 1\nmass: 2\n", ("line 2", "'mass' is given twice")),
    ("mass: !!python/object/apply:os.system ['true']\n", ("line 1", "tags", "not read")),
    ("mass: &a [1]\ndamping: *a\n", ("line 2", "aliases")),
    ("mass: [[1, 2\n", ("line 2", "not YAML")),
    ("mass: " + "[" * 5000, ("deeper than",)),
    ("- 1\n- 2\n", ("a mapping", "list")),
    ("just words\n", ("a mapping",)),
    ("", ("empty",)),
    ("# nothing\n", ("a mapping",)),
    ("? [1, 2]\n: 3\n", ("a key must be a word",)),
    ("mass: \x07\n", ("not YAML",)),
    ("degrees_of_freedom: 10000000\n", ("1..1000",)),
]  # fmt: skip


@pytest.mark.parametrize(("text", "words"), WRONG, ids=range(len(WRONG)))
def test_a_wrong_model_is_refused_with_the_place(tmp_path, text, words):
    message = refusal(written(tmp_path, text))
    for word in words:
        assert word in message


def test_no_tag_runs_code(tmp_path):
    witness = tmp_path / "ran"
    refusal(
        written(
            tmp_path,
            f"mass: !!python/object/apply:pathlib.Path.touch [!!python/object/apply:pathlib.Path ['{witness}']]\n",
        )
    )
    assert not witness.exists()


def test_the_whole_file_comes_back(tmp_path):
    model = read_model(written(tmp_path, FULL))
    write_model(model, tmp_path / "again.yaml", origin={"seed": 3})
    assert_same(read_model(tmp_path / "again.yaml"), model)
    text = (tmp_path / "again.yaml").read_text()
    assert "- [2.0, 0.0]" in text, "matrices are rows of numbers"
    assert yaml.safe_load(text)["sample_time"] == 0.01, "any YAML reader takes it"


numbers = st.floats(-1e100, 1e100).filter(lambda x: x == 0 or abs(x) > 1e-100)


@st.composite
def models(draw) -> Model:
    n = draw(st.integers(1, 4))
    matrices = [draw(arrays(np.float64, (n, n), elements=numbers)) for _ in range(3)]
    damping, stiffness = (np.triu(a) + np.triu(a, 1).T for a in matrices[1:])
    mass = np.diag(np.abs(np.diag(matrices[0])) + 1e-3)
    nu, ny = draw(st.integers(1, 3)), draw(st.integers(1, 3))
    mask = draw(arrays(bool, (n, n)))
    return Model(
        mass, damping, stiffness,
        input_map=draw(arrays(np.float64, (n, nu), elements=numbers)),
        output_map=draw(arrays(np.float64, (ny, n), elements=numbers)),
        output=draw(st.sampled_from(OUTPUTS)),
        hold=draw(st.sampled_from([None, *INTERSAMPLE.values()])),
        initial_state=draw(st.sampled_from(["free", "at_rest"])),
        free=draw(st.sampled_from([{}, {"stiffness": mask | mask.T}])),
        units=draw(st.sampled_from([{}, {"u": ["N"] * nu, "mass": "kg"}])),
        sample_time_s=draw(st.none() | st.floats(1e-9, 1e9)),
    )  # fmt: skip


@settings(max_examples=60, deadline=None)
@given(model=models())
def test_any_model_comes_back_bit_for_bit(tmp_path_factory, model):
    path = tmp_path_factory.mktemp("m") / "model.yaml"
    write_model(model, path)
    assert_same(read_model(path), model)
