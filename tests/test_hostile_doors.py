"""Records and models of every wrong size, shape and scale through simulate, identify and gap: an answer or one message,
never a traceback, and nothing said to be fine that is not."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections import Counter
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import yaml

from sysid_bench.__main__ import main
from sysid_bench.files import write_model
from sysid_bench.nouns import Model, Record
from sysid_bench.records import write_record

tried: Counter[str] = Counter()
SOME = ("arx", "variational_pem", "spline_ml")
OTHERS = ("n4sid_d2c", "n4sid_frf", "mdk_srivc", "variational_gauss2")


@pytest.fixture(scope="module", autouse=True)
def count_printed(pytestconfig):
    yield
    with pytestconfig.pluginmanager.getplugin("capturemanager").global_and_fixture_disabled():
        print(f"\nhostile calls of doors tried: {dict(sorted(tried.items()))}, {sum(tried.values())} in all")


def call(capsys, verb: str, *words: str) -> tuple[int, str]:
    """Exit code and what was said; a refusal is one line on stderr."""
    tried[verb] += 1
    code = main([verb, *words])
    said = capsys.readouterr()
    assert code in (0, 1, 2) and "Traceback" not in said.err + said.out, said.err
    told = [
        line for line in said.err.splitlines() if not line.startswith("[")
    ]  # progress of gap: [ 1.23 s] ...
    assert code != 2 or (len(told) == 1 and told[0].startswith("sysid-bench: ")), said.err
    return code, said.out + said.err


def one_dof(N: int = 400, h: float = 0.1, seed: int = 0) -> Record:
    """q'' + 0.4 q' + 4 q = u, held input, a little noise."""
    from sysid_bench.mechanics.simulate import simulate
    from sysid_bench.nouns import Plant

    rng = np.random.default_rng(seed)
    u = np.sign(rng.normal(size=(N, 1)))
    y = simulate(Plant([[1.0]], [[0.4]], [[4.0]]), u, h, "zoh")
    return Record(h * np.arange(N), u, y + 1e-3 * rng.normal(size=y.shape), "zoh")


def csv(path: Path, t, u, y) -> Path:
    """Written by hand: a Record would refuse some of these."""
    rows = np.column_stack([t, u, y])
    head = ["t", *(f"u{k + 1}" for k in range(np.shape(u)[1])), *(f"y{k + 1}" for k in range(np.shape(y)[1]))]
    path.write_text(
        "\n".join([",".join(head), *(",".join(map(repr, map(float, row))) for row in rows)]) + "\n"
    )
    return path


@pytest.fixture
def model(tmp_path: Path) -> Path:
    write_model(Model([[1.0]], [[0.4]], [[4.0]], hold="zoh"), tmp_path / "model.yaml")
    return tmp_path / "model.yaml"


def spoilt(kind: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    r = one_dof()
    t, u, y = r.t.copy(), r.u.copy(), r.y.copy()
    match kind:
        case "no samples":
            t, u, y = t[:0], u[:0], y[:0]
        case "one sample" | "two samples" | "nine samples":
            n = {"one sample": 1, "two samples": 2, "nine samples": 9}[kind]
            t, u, y = t[:n], u[:n], y[:n]
        case "nan":
            y[7] = np.nan
        case "inf":
            u[3] = np.inf
        case "constant input":
            u[:] = 1.0
        case "constant output":
            y[:] = 0.25
        case "silence":
            u[:], y[:] = 0.0, 0.0
        case "huge":
            u, y = u * 1e150, y * 1e150
        case "tiny":
            u, y = u * 1e-150, y * 1e-150
        case "odd scales":
            u, y = u * 1e12, y * 1e-12
        case "microseconds":
            t = t * 1e-9
        case "time stands still":
            t[:] = 0.0
        case "time runs back":
            t = t[::-1]
        case "one jump":
            y[200] = 1e6
    return t, u, y


SPOILT = ("nothing", "no samples", "one sample", "two samples", "nine samples", "nan", "inf", "constant input", "constant output",
          "silence", "huge", "tiny", "odd scales", "microseconds", "time stands still", "time runs back", "one jump")  # fmt: skip
REFUSED = {"no samples", "one sample", "nan", "inf", "time stands still", "time runs back"}
STILL = {"constant output", "silence"}
NO_ANSWER = {"two samples", "constant input", "constant output", "silence"}


@pytest.mark.parametrize("methods", [SOME, pytest.param(OTHERS, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", SPOILT)
def test_identify_a_spoilt_record(tmp_path: Path, capsys, model: Path, kind: str, methods) -> None:
    record = csv(tmp_path / "run.csv", *spoilt(kind))
    for method in methods:
        out = tmp_path / method
        words = [f"record={record}", f"model={model}", "method=mdk_srivc", f"out={out}", "views=false"]
        code, said = call(capsys, "identify", *words)
        assert code == 2 or kind not in REFUSED, said
        if code == 2:
            assert not out.exists(), "a refusal leaves nothing behind"
            continue
        estimate = json.loads((out / "estimate.json").read_text())
        assert (estimate["status"] == "ok") == (code == 0)
        if kind in NO_ANSWER:
            assert code == 1 or estimate.get("M") is None or "note: " in said, (
                f"{method} is silent on {kind}: {said}"
            )


@pytest.mark.parametrize("kind", SPOILT)
def test_gap_on_a_spoilt_record(tmp_path: Path, capsys, model: Path, kind: str) -> None:
    bad = csv(tmp_path / "bad.csv", *spoilt(kind))
    good = csv(tmp_path / "good.csv", *spoilt("nothing"))
    for k, (train, test) in enumerate(((bad, good), (good, bad))):
        out = tmp_path / f"gap{k}"
        words = [f"train={train}", f"test={test}", f"model={model}", f"out={out}", "views=false", "recording=false",
                 "power=false"]  # fmt: skip
        code, said = call(capsys, "gap", *words)
        assert code == 2 or kind not in REFUSED | STILL | {"huge"}, said
        assert kind not in STILL or "nothing moved" in said
        if train == good and kind in {"odd scales", "constant input"}:
            assert "none: " in said and "something is in them that the training records lack" in said, said
        elif kind == "nothing":
            assert "none: " in said and "the training records lack" not in said, said


def gap_in_units(
    folder: Path, capsys, force: float, displacement: float, duration: float
) -> tuple[str, float]:
    """Verdict and held-out gap of the same two records, their numbers those of other units."""
    folder.mkdir()
    M, D, K = (force / displacement * duration**k * x for k, x in ((2, 1.0), (1, 0.4), (0, 4.0)))
    write_model(Model([[M]], [[D]], [[K]], hold="zoh"), folder / "m.yaml")
    for name, seed in (("train", 0), ("test", 1)):
        r = one_dof(seed=seed)
        csv(folder / f"{name}.csv", duration * r.t, force * r.u, displacement * r.y)
    words = [f"train={folder / 'train.csv'}", f"test={folder / 'test.csv'}", f"model={folder / 'm.yaml'}"]
    words += [f"out={folder / 'out'}", "views=false", "recording=false", "power=false"]
    code, said = call(capsys, "gap", *words)
    assert code == 0, said
    values = json.loads((folder / "out" / "gap.json").read_text())
    assert values["force_gap"] is None, "judged on the force, as if the mass were free"
    return values["verdict"], values["gap_before"]


def test_gap_answers_the_same_in_any_units(tmp_path: Path, capsys) -> None:
    verdict, gap = gap_in_units(tmp_path / "si", capsys, 1.0, 1.0, 1.0)
    for k, units in enumerate(product((1e-12, 1e12), (1e-12, 1e12), (1e-6, 1e6))):
        other, found = gap_in_units(tmp_path / str(k), capsys, *units)
        assert other == verdict == "none" and found == pytest.approx(gap, rel=0.02), units


MODELS = {
    "zero mass": ("0.0", "1.0", "1.0"),
    "negative mass": ("-1.0", "1.0", "1.0"),
    "singular mass": ("[[1.0, 1.0], [1.0, 1.0]]", "[[1.0, 0.0], [0.0, 1.0]]", "[[2.0, 0.0], [0.0, 2.0]]"),
    "stiffness not symmetric": ("[[1.0, 0.0], [0.0, 1.0]]", "[[1.0, 0.0], [0.0, 1.0]]", "[[2.0, -1.0], [0.0, 2.0]]"),
    "sizes that differ": ("[[1.0, 0.0], [0.0, 1.0]]", "1.0", "1.0"),
    "not square": ("[[1.0, 0.0]]", "[[1.0, 0.0]]", "[[1.0, 0.0]]"),
    "nan": (".nan", "1.0", "1.0"),
    "infinite stiffness": ("1.0", "1.0", ".inf"),
    "wild units": ("1.0e-20", "1.0e-10", "1.0e+20"),
}  # fmt: skip
SOUND = {"wild units"}


@pytest.mark.parametrize("kind", MODELS)
def test_a_model_that_cannot_be(tmp_path: Path, capsys, kind: str) -> None:
    mass, damping, stiffness = MODELS[kind]
    path = tmp_path / "m.yaml"
    path.write_text(f"mass: {mass}\ndamping: {damping}\nstiffness: {stiffness}\n")
    n = len(yaml.safe_load(stiffness)) if stiffness.startswith("[") else 1
    rng = np.random.default_rng(0)
    record = csv(
        tmp_path / "run.csv", 0.1 * np.arange(300), rng.normal(size=(300, n)), rng.normal(size=(300, n))
    )
    simulate, _ = call(capsys, "simulate", f"model={path}", f"out={tmp_path / 'a.mcap'}", "sampling.N=50")
    files = [f"model={path}", f"out={tmp_path / 'out'}", "views=false"]
    identify, _ = call(capsys, "identify", f"record={record}", *files)
    gap, _ = call(
        capsys, "gap", f"train={record}", f"test={record}", *files, "recording=false", "power=false"
    )
    if kind not in SOUND:
        assert {simulate, identify, gap} == {2}
        assert not (tmp_path / "a.mcap").exists() and not (tmp_path / "out").exists()


def chain(n: int) -> Model:
    """n masses on a line."""
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    return Model(np.eye(n), 0.05 * K + 0.02 * np.eye(n), K, hold="zoh")


@pytest.mark.slow
def test_forty_degrees_of_freedom(tmp_path: Path, capsys) -> None:
    write_model(chain(40), tmp_path / "m.yaml")
    words = [
        f"model={tmp_path / 'm.yaml'}",
        "excitation=random_binary",
        "noise.snr_db=40",
        "sampling.h_s=0.25",
    ]
    assert call(capsys, "simulate", *words, "sampling.N=4000", f"out={tmp_path / 'run.mcap'}")[0] == 0
    files = [f"record={tmp_path / 'run.mcap'}", f"model={tmp_path / 'm.yaml'}", "views=false"]
    code, said = call(capsys, "identify", *files, "method=mdk_srivc", f"out={tmp_path / 'out'}")
    assert code == 0, said
    found = np.array(json.loads((tmp_path / "out" / "estimate.json").read_text())["K"]["value"])
    assert np.linalg.norm(found - chain(40).stiffness) < 0.2 * np.linalg.norm(chain(40).stiffness)


@pytest.mark.slow
@pytest.mark.full
def test_ten_million_samples_through_the_doors(tmp_path: Path, model: Path) -> None:
    """In a process of its own, its memory limited to 8 GB: an estimate, or a refusal in words."""
    run = tmp_path / "run.mcap"
    steps = [
        ["simulate", f"model={model}", "excitation=random_binary", "sampling.N=10000000", f"out={run}"],
        [
            "identify",
            f"record={run}",
            f"model={model}",
            "method=spline_ml",
            f"out={tmp_path / 'out'}",
            "views=false",
        ],
    ]

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (8 * 2**30, 8 * 2**30))

    for words in steps:
        done = subprocess.run(
            [sys.executable, "-m", "sysid_bench", *words], preexec_fn=limit, capture_output=True, text=True,
            cwd=Path(__file__).parents[1], timeout=1800,
        )  # fmt: skip
        assert done.returncode in (0, 2) and "Traceback" not in done.stderr, done.stderr[-2000:]
        if done.returncode == 2:
            assert done.stderr.count("\n") == 1
            return
    estimate = json.loads((tmp_path / "out" / "estimate.json").read_text())
    assert estimate["status"] == "ok"


def test_gap_refuses_records_that_would_fill_the_memory(tmp_path: Path, capsys, model: Path) -> None:
    N = 1_000_001
    t, u = 0.1 * np.arange(N), np.ones((N, 1))
    u[::2] = -1.0
    write_record(Record(t, u, 0.1 * u, "zoh"), tmp_path / "long.parquet")
    good = csv(tmp_path / "good.csv", *spoilt("nothing"))
    for train, test in ((tmp_path / "long.parquet", good), (good, tmp_path / "long.parquet")):
        words = [f"train={train}", f"test={test}", f"model={model}", f"out={tmp_path / 'gap'}"]
        code, said = call(capsys, "gap", *words)
        assert code == 2 and "1,000,001 samples of 1 degree(s) of freedom" in said, said


def test_outside_the_results_folder_is_refused(tmp_path: Path, capsys) -> None:
    for name in ("../out", "/tmp/out", "..", ".", "a/../../b", "", "\\0"):
        code, _ = call(capsys, "sweep", "plant=one_dof", f"study.name={name}", f"results_dir={tmp_path / 'results'}",
                       "views=false", "sampling.N=50")  # fmt: skip
        assert code == 2 or name == "\\0"
    assert [p.name for p in tmp_path.iterdir() if p.name != "results"] == []


@pytest.mark.parametrize(
    "word",
    [
        "plant._target_=os.system", "plant._target_=builtins.eval", "method._target_=subprocess.Popen",
        "plant._target_=sysid_bench.build.build", "plant._target_=sysid_bench", "executor._target_=pickle.loads",
        "plant.mass='!!python/object/apply:os.system [true]'", "plant.effects=[{_target_: os.system, command: true}]",
        "plugins=/nowhere", "plugins=os.system", "+plant.evil={_target_: os.system}",
    ],
)  # fmt: skip
def test_foreign_code_is_refused(tmp_path: Path, capsys, word: str) -> None:
    words = [
        "method=arx",
        "plant=one_dof",
        f"results_dir={tmp_path / 'results'}",
        "views=false",
        "sampling.N=50",
    ]
    code, said = call(capsys, "sweep", *words, word)
    assert code == 2, said
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize("verb", ["gap", "identify", "simulate", "measure", "rig", "papers"])
def test_no_place_for_results_is_told(tmp_path: Path, capsys, monkeypatch, verb: str, model: Path) -> None:
    """Nothing lands in the folder that happens to be the present one."""
    run = csv(tmp_path / "run.csv", *spoilt("nothing"))
    words = {
        "gap": [f"train={run}", f"test={run}", f"model={model}"],
        "identify": [f"record={run}", f"model={model}"],
    }
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    code, said = call(capsys, verb, *words.get(verb, []), "out=")
    assert code == 2 and "out=" in said and not list(Path().iterdir()), said


def test_a_proof_on_a_training_record_is_told_to_be_none(tmp_path: Path, capsys, model: Path) -> None:
    run, other = (csv(tmp_path / f"{name}.csv", *spoilt("nothing")) for name in ("run", "other"))
    words = [
        f"train={run}",
        f"model={model}",
        f"out={tmp_path / 'gap'}",
        "views=false",
        "recording=false",
        "power=false",
    ]
    for test, told in ((f"{tmp_path}/./run.csv", True), (other, False)):
        code, said = call(capsys, "gap", *words, f"test={test}")
        assert code == 0 and ("proves nothing" in said) == told, said


def test_a_record_list_where_one_is_wanted(tmp_path: Path, capsys, model: Path) -> None:
    files = [f"model={model}", f"out={tmp_path / 'out'}"]
    code, said = call(capsys, "identify", "record=a.csv,b.csv", *files)
    assert code == 2 and "one file is wanted" in said


def test_a_noise_beyond_numbers_is_named(tmp_path: Path, capsys) -> None:
    code, said = call(capsys, "simulate", "noise.snr_db=-1e9", "sampling.N=50", f"out={tmp_path / 'a.csv'}")
    assert code == 2 and "snr_db" in said and "Record.y" not in said


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (["plant.nosuch=3"], "plant.nosuch: plant=three_dof has no 'nosuch'. It has: mass, damping"),
        (["plant=three_doff"], "plant=three_doff: no such option; did you mean three_dof?"),
        (["samplng.h_s=1"], "simulate has no 'samplng.h_s'"),
        (["noise.snrdb=3"], "did you mean snr_db?"),
    ],
)
def test_an_unknown_word_is_told_what_there_is(capsys, words: list[str], wanted: str) -> None:
    code, said = call(capsys, "simulate", "out=a.csv", *words)
    assert code == 2 and wanted in said, said


def test_a_long_name_is_cut_by_bytes(tmp_path: Path) -> None:
    path = tmp_path / ("ü" * 120 + ".csv")
    write_record(one_dof(50), path)
    assert path.is_file() and len(list(tmp_path.iterdir())) == 1
