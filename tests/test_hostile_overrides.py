"""Nonsense on the command line: every knob of the file verbs, one message each, never a traceback. Counts are printed."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sysid_bench.__main__ import main
from sysid_bench.build import build
from sysid_bench.conf import compose
from sysid_bench.files import write_model
from sysid_bench.noises.white import White
from sysid_bench.nouns import InputError, Model, Sampling

NONSENSE = (
    "abc", "-1", "0", "null", "[]", "{}", "1e400", "nan", "inf", "[1,2]", "true", "''", "1e-300", "[[1,2],[3]]", "{a: 1}",
    "99999999999999999999", "-0.5", "${oc.env:HOME}", "${x", "[x", "a=b", "'", "é", "!!python/none", "../../x",
)  # fmt: skip


def knobs(node: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    for key, value in node.items():
        yield prefix + key
        if isinstance(value, Mapping):
            yield from knobs(value, f"{prefix}{key}.")


def tried_on(capsys, verb: str, words: list[str], most: int | None) -> Counter[int]:
    """Exit codes of the verb with each knob set to each nonsense, or `most` of these at random."""
    config = {key: value for key, value in compose(verb, words).items() if key != "choices"}
    attempts = [
        f"{knob}={value}" for knob in knobs(config) for value in NONSENSE if not knob.startswith("out")
    ]
    chosen = attempts if most is None else random.Random(1).sample(attempts, most)
    codes: Counter[int] = Counter()
    for override in chosen:
        code = main([verb, *words, override])
        said = capsys.readouterr()
        assert code in (0, 1, 2) and "Traceback" not in said.err, override
        assert code != 2 or (said.err.startswith("sysid-bench: ") and said.err.count("\n") == 1), override
        codes[code] += 1
    return codes


def print_counts(capsys, verb: str, codes: Counter[int]) -> None:
    with capsys.disabled():
        print(f"\n{verb}: {codes.total()} overrides tried, exit codes {dict(sorted(codes.items()))}")


@pytest.fixture
def files(tmp_path, capsys) -> Path:
    write_model(Model(np.eye(1), np.eye(1), np.eye(1), hold="zoh"), tmp_path / "model.yaml")
    words = ["plant=one_dof", "excitation=random_binary", "sampling.N=300", f"out={tmp_path / 'run.csv'}"]
    assert main(["simulate", *words]) == 0
    capsys.readouterr()
    return tmp_path


SOME = pytest.param(60, id="some")
ALL = pytest.param(None, id="all", marks=[pytest.mark.slow, pytest.mark.full])


@pytest.mark.parametrize("most", [SOME, ALL])
def test_simulate(tmp_path, capsys, most):
    words = ["plant=one_dof", "sampling.N=40", f"out={tmp_path / 'a.csv'}"]
    print_counts(capsys, "simulate", tried_on(capsys, "simulate", words, most))


@pytest.mark.parametrize("most", [SOME, ALL])
def test_sweep(tmp_path, capsys, monkeypatch, most):
    monkeypatch.chdir(tmp_path)  # some nonsense is a folder's name
    words = [
        "plant=one_dof",
        "method=arx_least_squares",
        "sampling.N=40",
        "executor=serial",
        "views=false",
        "records=none",
    ]
    print_counts(capsys, "sweep", tried_on(capsys, "sweep", words, most))


@pytest.mark.parametrize("most", [SOME, ALL])
@pytest.mark.parametrize("method", ["arx", "variational_pem"])
def test_identify(files, capsys, most, method):
    words = [
        f"record={files / 'run.csv'}",
        f"model={files / 'model.yaml'}",
        f"out={files / 'out'}",
        f"method={method}",
    ]
    codes = tried_on(capsys, "identify", [*words, "views=false"], None if most is None else 25)
    print_counts(capsys, f"identify method={method}", codes)


@pytest.mark.parametrize(
    ("target", "knobs", "words"),
    [
        (Sampling, {"N": "many"}, "Sampling.N must be a whole number; got 'many'"),
        (Sampling, {"N": 6e3}, "Sampling.N must be a whole number; got 6000.0"),
        (Sampling, {"h_s": None}, "Sampling.h_s must be a number; got None"),
        (Sampling, {"h_s": True}, "Sampling.h_s must be a number; got True"),
        (White, {"snr_db": ["a"]}, "White.snr_db must be a number or a list"),
        (White, {"snr_db": {"a": 1}}, "White.snr_db must be a number or a list"),
    ],
)
def test_a_knob_of_the_wrong_kind_is_named(target, knobs, words):
    with pytest.raises(InputError) as caught:
        build({"_target_": f"{target.__module__}.{target.__name__}", **knobs})
    assert words in str(caught.value)
