"""estimate.json: the fields of the contract, no NaN, and the same estimate back."""

from __future__ import annotations

import json

import numpy as np
import pytest

from sysid_bench.files import model_of, read_estimate, write_estimate
from sysid_bench.mechanics.second_order import poles
from sysid_bench.mechanics.uncertainty import modal_uncertainty
from sysid_bench.nouns import Estimate, InputError, Model

M, D, K = (
    np.array([[2.0, 0.1], [0.1, 1.0]]),
    np.array([[0.3, 0.0], [0.0, 0.1]]),
    np.array([[5.0, -1.0], [-1.0, 3.0]]),
)
MODEL = Model(M, D, K, input_map=[[1.0], [0.0]], output="velocity", hold="cubic")


def estimate(**more) -> Estimate:
    root = np.random.default_rng(0).normal(size=(9, 9))
    values = dict(
        M=M, D=D, K=K, covariance=root @ root.T, poles=np.array([-0.1 + 2j, -0.1 - 2j, -0.5 + 0j, -0.2 + 0j]),
        state_space=(np.eye(4), np.ones((4, 1)), np.ones((2, 4)), np.zeros((2, 1)), 0.1),
        coefficients={"a1": -1.5}, seconds=0.25, diagnostics={"iterations": 7, "cost": np.float64(1.5)},
    )  # fmt: skip
    return Estimate(**(values | more))


def write_and_load(tmp_path, value: Estimate, **more) -> dict:
    write_estimate(value, tmp_path / "estimate.json", method="variational_pem", **more)

    def refuse(word):
        raise AssertionError(f"bare {word} in estimate.json")

    return json.loads((tmp_path / "estimate.json").read_text(), parse_constant=refuse)


def test_the_fields_of_the_contract(tmp_path):
    value = estimate()
    found = write_and_load(tmp_path, value, model=MODEL, origin={"seed": 1})
    assert (found["status"], found["method"], found["seconds"]) == ("ok", "variational_pem", 0.25)
    for name, matrix in (("M", M), ("D", D), ("K", K)):
        assert found[name]["value"] == matrix.tolist()
        assert np.allclose(found[name]["std"], value.std(name))
    assert found["poles"][0] == [-0.1, 2.0]
    assert found["omega_n"][0] == pytest.approx(abs(-0.1 + 2j))
    assert found["zeta"] == pytest.approx([0.1 / abs(0.1 + 2j)] * 2 + [1.0, 1.0])
    assert found["origin"] == {"seed": 1}


def test_the_estimate_comes_back(tmp_path):
    value = estimate()
    write_and_load(tmp_path, value, model=MODEL)
    back, values = read_estimate(tmp_path / "estimate.json")
    for name in ("M", "D", "K", "covariance", "poles"):
        assert np.array_equal(getattr(back, name), getattr(value, name)), name
    for one, other in zip(back.state_space, value.state_space, strict=True):
        assert np.array_equal(one, other)
    assert (back.status, back.seconds, back.coefficients) == ("ok", 0.25, {"a1": -1.5})
    model = model_of(back, values, "estimate.json")
    assert np.array_equal(model.mass, M) and np.array_equal(model.input_map, MODEL.input_map)
    assert (model.output, model.hold) == ("velocity", "cubic")


def test_a_failure_and_values_that_are_not_finite(tmp_path):
    failed = Estimate(
        status="diverged", reason="the step grew", diagnostics={"cost": np.nan, "worst": np.inf}
    )
    found = write_and_load(tmp_path, failed)
    assert (found["M"], found["poles"]) == (None, None)
    assert found["diagnostics"] == {"cost": None, "worst": None}
    back, values = read_estimate(tmp_path / "estimate.json")
    assert (back.status, back.reason, back.M) == ("diverged", "the step grew", None)
    with pytest.raises(InputError, match=r"no M, D, K \(status diverged: the step grew\)"):
        model_of(back, values, "estimate.json")


def test_without_covariance_the_standard_errors_are_null(tmp_path):
    found = write_and_load(tmp_path, estimate(covariance=None))
    assert found["M"]["std"] is None
    assert read_estimate(tmp_path / "estimate.json")[0].covariance is None


def test_standard_errors_alone_make_a_diagonal_covariance(tmp_path):
    found = write_and_load(tmp_path, estimate())
    del found["covariance"]
    (tmp_path / "estimate.json").write_text(json.dumps(found))
    back, _ = read_estimate(tmp_path / "estimate.json")
    assert np.allclose(back.std("K"), estimate().std("K"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"status": "fine"}, "`status`, one of ok"),
        ({"M": [[1.0]]}, "M must be {value, std}"),
        ({"M": {"value": [[1.0, "x"]]}}, "M.value must be a nested list"),
        ({"M": {"value": [[1.0]]}}, "D must hold 1x1"),
        ({"M": {"value": [[1.0, None], [None, 1.0]]}}, "M.value must be finite"),
        ({"M": {"std": [[1.0]]}}, "M has a std but no value"),
        ({"poles": [1.0, 2.0]}, "poles must be a nested list"),
        ({"poles": [[1.0, 2.0, 3.0]]}, "pairs"),
        ({"covariance": [[1.0]]}, "covariance must be 9 square"),
        ({"state_space": {"A": [[1.0]]}}, "A, B, C, D and h_s"),
        ({"diagnostics": [1]}, "diagnostics must be a mapping"),
        ({"model": {"mas": 1}}, None),
    ],
)
def test_a_wrong_estimate_is_refused(tmp_path, change, words):
    found = write_and_load(tmp_path, estimate(), model=MODEL) | change
    path = tmp_path / "estimate.json"
    path.write_text(json.dumps(found))
    with pytest.raises(InputError) as caught:
        model_of(*read_estimate(path), path)
    assert str(path) in str(caught.value) and (words or "unknown key 'mas'") in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[1]", "nul", "[" * 100_000, "\x00\xff", '{"status": "ok"'])
def test_no_json_is_refused(tmp_path, text):
    path = tmp_path / "estimate.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match="estimate"):
        read_estimate(path)


def test_modes_carry_their_standard_errors(tmp_path):
    found = write_and_load(tmp_path, estimate(poles=poles(M, D, K)))["modes"]
    known = modal_uncertainty(M, D, K, estimate().covariance)
    assert np.allclose(found["omega_n_std"], known.omega_n_std)
    assert np.allclose(found["covariance"], known.covariance)
    assert np.allclose(found["pole_std"], np.stack([known.pole_std.real, known.pole_std.imag], axis=1))
    assert write_and_load(tmp_path, estimate())["modes"] is None  # poles of something else than M, D, K
