"""Nonsense on the command line: every knob of every verb, one message each, never a traceback. Counts are printed."""

from __future__ import annotations

import random
import shutil
import signal
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sysid_bench.__main__ import main
from sysid_bench.build import build
from sysid_bench.conf import compose
from sysid_bench.emulator.process import Emulator
from sysid_bench.files import write_model
from sysid_bench.noises.white import White
from sysid_bench.nouns import InputError, Model, Sampling
from sysid_bench.views import viewer

REPOSITORY = Path(__file__).parents[1]
NONSENSE = (
    "abc", "-1", "0", "null", "[]", "{}", "1e400", "nan", "inf", "[1,2]", "true", "''", "1e-300", "[[1,2],[3]]", "{a: 1}",
    "99999999999999999999", "-0.5", "${oc.env:HOME}", "${x", "[x", "a=b", "'", "é", "!!python/none", "../../x",
)  # fmt: skip
# What makes each verb quick; {} is the folder of the files it reads.
WORDS = {
    "simulate": ["plant=one_dof", "sampling.N=40", "out=a.csv"],
    "sweep": ["plant=one_dof", "method=arx_least_squares", "sampling.N=40", "executor=serial", "views=false", "records=none"],
    "identify method=arx": ["record={}/run.csv", "model={}/model.yaml", "method=arx", "out=out", "views=false"],
    "identify method=variational_pem": [
        "record={}/run.csv", "model={}/model.yaml", "method=variational_pem", "out=out", "views=false"],
    "gap": ["train={}/run.csv", "test={}/run.csv", "model={}/model.yaml", "out=out", "views=false", "recording=false", "power=false"],
    "measure": ["bus=virtual", "rig=second_order_1", "seconds=1", "model={}/model.yaml", "out=run.mcap", "dry_run=true"],
    "emulate": ["bus=virtual", "rig=second_order_1", "plant=one_dof"],
    "check": ["only=plant=one_dof method=arx_least_squares", "executor=serial", "reference={}/reference"],
    "export": ["estimate={}/identified/estimate.json", "to=estimate.xml"],
    "papers": ["results_dir={}", "out=papers.md"],
    "view": ["path={}/run.csv", "out=run.rrd"],
}  # fmt: skip
FEW = {"gap": 15, "check": 15, "identify method=arx": 25, "identify method=variational_pem": 25}


def knobs(node: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    for key, value in node.items():
        yield prefix + key
        if isinstance(value, Mapping):
            yield from knobs(value, f"{prefix}{key}.")


def tried_on(capsys, verb: str, words: list[str], most: int | None) -> Counter[int]:
    """Exit codes of the verb with each knob set to each nonsense, or `most` of these at random."""
    config = {key: value for key, value in compose(verb, words).items() if key != "choices"}
    attempts = [f"{knob}={value}" for knob in knobs(config) for value in NONSENSE]
    chosen = attempts if most is None else random.Random(1).sample(attempts, min(most, len(attempts)))
    codes: Counter[int] = Counter()
    for override in chosen:
        code = main([verb, *words, override])
        said = capsys.readouterr()
        assert code in (0, 1, 2) and "Traceback" not in said.err, override
        told = [line for line in said.err.splitlines() if not line.startswith(("[", "  "))]  # progress, lists
        assert code != 2 or (told[0].startswith("sysid-bench: ") and len(told) == 1), (override, said.err)
        codes[code] += 1
    return codes


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A record, its model, an estimate, the reference tables."""
    folder = tmp_path_factory.mktemp("files")
    write_model(Model(np.eye(1), np.eye(1), np.eye(1), hold="zoh"), folder / "model.yaml")
    words = ["plant=one_dof", "excitation=random_binary", "sampling.N=300", f"out={folder / 'run.csv'}"]
    assert main(["simulate", *words]) == 0
    words = [f"record={folder / 'run.csv'}", f"model={folder / 'model.yaml'}", f"out={folder / 'identified'}"]
    assert main(["identify", *words, "method=spline_ml", "views=false"]) == 0
    shutil.copytree(REPOSITORY / "results" / "reference", folder / "reference")
    return folder


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch) -> Iterator[None]:
    """Nonsense may be a folder's name, `../../x` too; a device that is started ends at once."""
    (tmp_path / "a" / "b").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "a" / "b")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    run = Emulator.run

    def briefly(self: Emulator, until) -> None:
        end = time.monotonic() + 0.05
        run(self, lambda: until() or time.monotonic() > end)

    monkeypatch.setattr(Emulator, "run", briefly)
    monkeypatch.setattr(viewer, "serve", lambda rrd: 0)  # else until Ctrl-C
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(
    "all_of_them",
    [
        pytest.param(False, id="some"),
        pytest.param(True, id="all", marks=[pytest.mark.slow, pytest.mark.full]),
    ],
)
@pytest.mark.parametrize("name", WORDS)
def test_every_knob(files: Path, elsewhere: None, capsys, name: str, all_of_them: bool) -> None:
    words = [word.format(files) for word in WORDS[name]]
    codes = tried_on(capsys, name.split()[0], words, None if all_of_them else FEW.get(name, 60))
    assert set(codes) <= {0, 1, 2} and codes[2] > 0  # of so much nonsense some must have been refused
    with capsys.disabled():
        print(f"\n{name}: {codes.total()} overrides tried, exit codes {dict(sorted(codes.items()))}")


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
