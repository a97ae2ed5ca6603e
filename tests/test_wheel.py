"""The built wheel, unpacked anywhere, is the whole suite: configs, studies, DBC files, report templates."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    done = subprocess.run(build, cwd=REPOSITORY, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def outside(site: Path, cwd: Path, *words: str) -> str:
    """stdout of python WORDS with the unpacked wheel in front of everything else."""
    env = {**os.environ, "PYTHONPATH": str(site)}
    done = subprocess.run(
        [sys.executable, *words], cwd=cwd, env=env, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_wheel_runs_a_shipped_study_with_its_report(unpacked: Path, tmp_path: Path) -> None:
    where = outside(unpacked, tmp_path, "-c", "import sysid_bench; print(sysid_bench.__file__)")
    assert Path(where.strip()).is_relative_to(unpacked)
    words = ["experiment=smoke", "axes.method=[arx]", "study.repetitions=1", "executor=serial"]
    outside(unpacked, tmp_path, "-m", "sysid_bench", "sweep", *words)
    made = {p.name for p in (tmp_path / "results" / "smoke").iterdir()}
    assert {"table.parquet", "summary.csv", "report.html", "study.rrd", "figures"} <= made


def test_the_wheel_has_every_verb_option_and_study_of_the_repository(unpacked: Path, tmp_path: Path) -> None:
    code = "from sysid_bench import conf; print(conf.verbs(), conf.groups(), conf.studies())"
    here = subprocess.run([sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True)
    assert outside(unpacked, tmp_path, "-c", code) == here.stdout != ""


def test_the_wheel_holds_the_dbc_files_of_its_rigs(unpacked: Path, tmp_path: Path) -> None:
    code = (
        "from sysid_bench import conf; from sysid_bench.build import build\n"
        "for name in conf.groups()['rig']: print(build(conf.option('rig', name)).dbc_path)"
    )
    paths = outside(unpacked, tmp_path, "-c", code).split()
    assert paths and all(Path(p).is_relative_to(unpacked) for p in paths)
