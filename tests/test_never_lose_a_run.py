"""Sweeps killed at random moments, side by side, on a full disk: they go on to the table of an undisturbed one."""

import random
import resource
import shutil
import subprocess
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from trivial_study import Runner, kill_after, table, words, workers_of

from sysid_bench.store import Store

KILLS, CELLS, MANY = 50, 500, 6000


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trivial")
    return folder


@pytest.fixture(scope="module")
def runner(home: Path) -> Iterator[Runner]:
    runner = Runner(home)
    yield runner
    runner.close()


@pytest.fixture(scope="module")
def undisturbed(home: Path, runner: Runner) -> tuple[dict[str, list[str]], float]:
    """(the table, the seconds that it takes)"""
    assert runner.run(words(home / "first", 1, "executor=serial")) == 0
    start = time.monotonic()
    assert runner.run(words(home / "whole", CELLS, "executor=serial")) == 0
    return table(home / "whole"), time.monotonic() - start


def leftovers(results: Path) -> list[str]:
    return [path.name for path in results.rglob("*") if path.name.endswith((".part", "-journal"))]


@pytest.mark.slow
def test_killed_at_random_moments_it_ends_in_the_same_table(home, runner, undisturbed, capsys) -> None:
    whole, seconds = undisturbed
    chance = random.Random(6)
    kills: Counter[str] = Counter()
    studies = 0
    while kills.total() < KILLS:
        studies += 1
        results = home / f"killed{studies}"
        line = words(results, CELLS)
        finished, attempts = False, 0
        while not finished:
            attempts += 1
            local = chance.random() < 0.1
            worker = local and chance.random() < 0.5
            executor = ["executor=local", "executor.workers=2"] if local else ["executor=serial"]
            moment = chance.uniform(
                0, 0.3 * seconds * 1.2**attempts
            )  # longer each time: a busy machine gets there, too
            code = runner.run([*line, *executor], kill_after(moment, worker))
            finished = code == 0 and not worker
            assert code in (0, -9), runner.log.read_text()
            kills["worker" if worker else "parent"] += worker or code == -9
        assert runner.run([*line, "retry=error", "executor=serial"]) == 0, runner.log.read_text()
        assert table(results) == whole and leftovers(results) == []
        shutil.rmtree(results)
    with capsys.disabled():
        print(
            f"\nkilled {dict(kills)} in {studies} studies of {CELLS} cells: every table as the undisturbed one"
        )


def test_a_killed_sweep_leaves_no_worker_behind(home: Path, runner: Runner) -> None:
    pid = runner.start(words(home / "orphans", 5000, "executor=local", "executor.workers=2"))
    while len(found := workers_of(pid)) < 2:
        time.sleep(0.01)
    kill_after(0.3)(pid)
    assert runner.finish() == -9
    _, alive = psutil.wait_procs([psutil.Process(p) for p in found if psutil.pid_exists(p)], timeout=30)
    assert not alive


def test_two_sweeps_of_one_study_do_each_other_no_harm(home: Path, runner: Runner, undisturbed) -> None:
    whole, seconds = undisturbed
    other = Runner(home)
    line = words(home / "both", CELLS, "executor=serial")
    runner.start(line)
    code = other.run(line, kill_after(seconds / 3))
    assert code in (0, -9) and other.run(line) == 0, other.log.read_text()
    assert runner.finish() == 0, runner.log.read_text()
    other.close()
    assert table(home / "both") == whole and leftovers(home / "both") == []


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 600 kB; `mount -o remount,size=...` makes room."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=600k", "tmpfs", str(folder)]
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("a small file system cannot be mounted here (that takes root)")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def resize(disk: Path, size: str) -> None:
    subprocess.run(["mount", "-o", f"remount,size={size}", str(disk)], check=True)


def kept_rows(results: Path) -> int:
    with Store(results / "trivial" / "rows.sqlite") as store:
        return len(store.done())


def test_a_full_disk_stops_the_sweep_and_room_lets_it_go_on(home, runner, small_disk) -> None:
    """The disk holds the rows of half a second (one transaction) on the fastest machine, and not those of all cells."""
    resize(small_disk, "1200k")
    line = words(small_disk, MANY, "executor=serial")
    assert runner.run(line) == 2
    said = runner.log.read_text().strip().splitlines()
    assert (
        said[-1].startswith("sysid-bench: rows cannot be written (") and "those stored are kept" in said[-1]
    )
    assert "Traceback" not in runner.log.read_text()
    assert runner.run(line) == 2, "and again, while it is full"
    resize(small_disk, "100m")
    assert 0 < kept_rows(small_disk) < MANY
    assert runner.run(line) == 0, runner.log.read_text()
    assert runner.run(words(home / "many", MANY, "executor=serial")) == 0
    assert table(small_disk) == table(home / "many")


def test_a_record_that_cannot_be_kept_stops_the_sweep(home: Path, runner: Runner, small_disk: Path) -> None:
    line = ["sweep", "study.name=trivial", "plant=one_dof", "method=arx_least_squares", "sampling.N=3000", "records=all",
            "study.repetitions=30", "views=false", "executor=serial", f"results_dir={small_disk}"]  # fmt: skip
    assert runner.run(line) == 2
    assert "the record cannot be kept: cannot write" in runner.log.read_text().splitlines()[-1]
    assert "No space left" in runner.log.read_text()
    resize(small_disk, "100m")
    assert runner.run(line) == 0, runner.log.read_text()
    assert set(table(small_disk)["status"]) == {"'ok'"}
    assert len(list((small_disk / "trivial" / "records").glob("*.mcap"))) == 30


def test_a_file_that_may_not_grow_stops_the_sweep_too(home: Path, undisturbed, tmp_path: Path) -> None:
    """Where no file system can be mounted: the limit of a file's size is a full disk, to the sweep."""
    limited = Runner(tmp_path)
    resource.prlimit(limited.process.pid, resource.RLIMIT_FSIZE, (150_000, resource.RLIM_INFINITY))
    line = words(tmp_path, CELLS, "executor=serial")
    assert limited.run(line) == 2
    assert "those stored are kept" in limited.log.read_text().splitlines()[-1]
    resource.prlimit(
        limited.process.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
    )
    assert 0 < kept_rows(tmp_path) < CELLS
    assert limited.run(line) == 0, limited.log.read_text()
    limited.close()
    assert table(tmp_path) == undisturbed[0]
