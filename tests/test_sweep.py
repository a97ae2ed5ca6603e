"""The spine from a config to an error table, through the command line as a user meets it."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from sysid_bench.table import read_table

TIMES = ("fit_s",)
STUDY = [
    "study.name=small",
    "plant=one_dof",
    "excitation=cubic_noise",
    "excitation.knot_spacing_s=1.0",
    "sampling.N=600",
    "study.repetitions=3",
    "axes.method=[arx,n4sid_d2c]",
    "axes.noise=[none,white]",
    "views=false",
]


def sysid_bench(*words: str, cwd: Path, check: bool = True) -> subprocess.CompletedProcess[str]:
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    done = subprocess.run(
        [sys.executable, "-m", "sysid_bench", *words],
        cwd=cwd,
        env=env,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert not check or done.returncode == 0, done.stdout + done.stderr
    return done


def table_without_times(folder: Path) -> dict[str, list[object]]:
    table = read_table(folder / "table.parquet")
    return {name: [str(v) for v in column] for name, column in table.items() if name not in TIMES}


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sweep")
    sysid_bench("sweep", *STUDY, "executor=serial", cwd=folder)
    return folder / "results" / "small"


def test_a_sweep_leaves_table_summary_manifest_and_first_records(finished: Path) -> None:
    table = read_table(finished / "table.parquet")
    assert len(table["key"]) == 12
    assert {"M_error", "D_bound", "pole_over_bound", "a1", "a1_theory", "seed", "fit_s"} <= set(table)
    assert len(list((finished / "records").glob("*.mcap"))) == 2
    manifest = json.loads((finished / "manifest.json").read_text())
    assert manifest["cells"] == 12 and manifest["origin"]["packages"]["numpy"]
    assert (finished / "summary.csv").read_text().count("\n") == 5


def test_all_methods_see_the_same_record(finished: Path) -> None:
    table = read_table(finished / "table.parquet")
    for seed in set(table["seed"]):
        assert len(set(table["M_bound"][(table["seed"] == seed) & (table["noise"] == "white")])) <= 1


def test_local_processes_give_the_same_table(finished: Path, tmp_path: Path) -> None:
    sysid_bench("sweep", *STUDY, "executor=local", "executor.workers=2", cwd=tmp_path)
    assert table_without_times(tmp_path / "results" / "small") == table_without_times(finished)


def test_a_second_run_computes_nothing_and_a_part_is_a_part(finished: Path) -> None:
    before = read_table(finished / "table.parquet")
    sysid_bench("sweep", *STUDY, cwd=finished.parents[1])
    after = read_table(finished / "table.parquet")
    assert np.array_equal(before["fit_s"], after["fit_s"], equal_nan=True)
    sysid_bench("sweep", *STUDY, "only=method=arx repetition=1", cwd=finished.parents[1])
    assert len(read_table(finished / "table.parquet")["key"]) == 2
    sysid_bench("sweep", *STUDY, cwd=finished.parents[1])


@pytest.mark.parametrize("wait_s", [1.2, 2.5, 3.2])
def test_killed_at_any_moment_it_goes_on_and_ends_in_the_same_table(
    finished: Path, tmp_path: Path, wait_s: float
) -> None:
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    words = [sys.executable, "-m", "sysid_bench", "sweep", *STUDY]
    process = subprocess.Popen(
        words, cwd=tmp_path, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    time.sleep(wait_s)
    process.send_signal(signal.SIGKILL)
    process.wait()
    sysid_bench("sweep", *STUDY, cwd=tmp_path)
    assert table_without_times(tmp_path / "results" / "small") == table_without_times(finished)


METHOD = '''
"""record -> the identity: the smallest method there is."""

from dataclasses import dataclass

import numpy as np

from sysid_bench.nouns import Estimate, Model, NotApplicable, Record


@dataclass(frozen=True)
class Guess:
    """Answers M = D = K = scale times the identity, whatever the record says."""

    scale: float = 1.0
    nominal: bool = False

    def fit(self, record: Record, model: Model) -> Estimate:
        if record.N > 10_000:
            raise NotApplicable("too long to guess")
        eye = self.scale * np.eye(model.n)
        return Estimate(M=eye, D=eye, K=eye)
'''


def test_a_method_of_ones_own_is_one_file_and_one_yaml(tmp_path: Path) -> None:
    (tmp_path / "mine" / "own_methods").mkdir(parents=True)
    (tmp_path / "mine" / "conf" / "method").mkdir(parents=True)
    (tmp_path / "mine" / "own_methods" / "__init__.py").write_text('"""Methods of my own."""\n')
    (tmp_path / "mine" / "own_methods" / "guess.py").write_text(METHOD)
    yaml = "_target_: own_methods.guess.Guess\nscale: 1.0\nnominal: false\n"
    (tmp_path / "mine" / "conf" / "method" / "guess.yaml").write_text(yaml)
    words = [w.replace("[arx,n4sid_d2c]", "[arx,guess]") for w in STUDY]
    sysid_bench("sweep", *words, "plugins=mine", "executor=local", cwd=tmp_path)
    table = read_table(tmp_path / "results" / "small" / "table.parquet")
    guesses = table["method"] == "guess"
    assert guesses.sum() == 6 and np.all(table["M_error"][guesses] == 0.0)
    check = (
        "from sysid_bench.conf import Plugins; from sysid_bench.contracts import check_option;"
        "check_option('method', 'guess', Plugins.named('mine'))"
    )
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    done = subprocess.run(
        [sys.executable, "-c", check], cwd=tmp_path, env=env, capture_output=True, text=True
    )
    assert "far off on noise-free data" in done.stderr, "the contract tests must catch a method that guesses"
    refused = sysid_bench("sweep", *words, "method=guess", cwd=tmp_path, check=False)
    assert refused.returncode == 2 and "guess" in refused.stderr


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (["plant=two_dof"], "three_dof"),
        (["experiment=nowhere"], "no such study"),
        (["noise.snr=3"], "snr"),
        (["axes.method=[nothing]"], "method has: "),
        (["study.kind=guess"], "identify, analysis"),
        (["records=some"], "none, first or all"),
        (["study.name=../outside"], "inside"),
        (["retry=often"], "no status"),
        (["only=method"], "KEY=VALUE"),
        (["only=method=absent"], "no cell"),
        (["executor.workers=0"], "at least 1"),
        (["plant._target_=os.system"], "refused"),
        (["nonsense"], "KEY=VALUE"),
        (["excitation.knot_spacing_s=0.25", "sampling.h_s=0.1"], "divide"),
    ],
)
def test_a_wrong_call_is_one_message_and_exit_code_2(words: list[str], wanted: str, tmp_path: Path) -> None:
    done = sysid_bench("sweep", "study.name=small", "views=false", *words, cwd=tmp_path, check=False)
    assert done.returncode == 2, done.stdout + done.stderr
    assert "Traceback" not in done.stderr and done.stderr.startswith("sysid-bench: ")
    assert wanted in done.stderr
    assert not (tmp_path / "results").exists(), "a wrong call leaves nothing behind"
