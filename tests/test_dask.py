"""The dask executor against a real scheduler and worker processes."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from sysid_bench.executors.serial import Serial
from sysid_bench.nouns import Cell, InputError, Task

pytest.importorskip("distributed", reason="pip install 'sysid-bench[dask]'")
from sysid_bench.executors.dask import Dask


def task(name: str, *behaviours: str) -> Task:
    cells = tuple(Cell(f"{name}{k}", json.dumps(b), {"method": b}) for k, b in enumerate(behaviours))
    return Task("study", "identify", {}, 1, 0, {}, cells, name)


def work(task: Task) -> Iterator[dict[str, Any]]:
    for cell in task.cells:
        behaviour = json.loads(cell.solver)
        if behaviour == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if behaviour == "slow":
            time.sleep(0.05)
        yield task.row(cell, status="ok", reason="", value=len(cell.key) / 3)


def by_key(rows: Any) -> dict[str, dict[str, Any]]:
    return {row["key"]: row for row in rows}


def test_a_local_cluster_gives_the_rows_of_serial_and_a_deadly_cell_is_a_row() -> None:
    tasks = [task(f"t{k}", "ok", "ok") for k in range(25)]
    rows = by_key(Dask(workers=2, chunk=4).run(work, [*tasks, task("x", "ok", "die")]))
    dead = rows.pop("x1")
    assert dead["status"] == "error" and "Killed" in dead["reason"]
    assert rows.pop("x0")["status"] == "ok"
    assert rows == by_key(Serial().run(work, tasks))


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    scheduler_file = tmp_path / "scheduler.json"
    env = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), str(Path(__file__).parent)]),
    }
    quiet: dict[str, Any] = {
        "stdout": subprocess.DEVNULL,
        "stderr": subprocess.DEVNULL,
        "env": env,
        "cwd": tmp_path,
    }
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    processes = [
        subprocess.Popen([*command, "--no-dashboard", "--scheduler-file", str(scheduler_file)], **quiet)
    ]
    deadline = time.monotonic() + 60
    while not scheduler_file.exists():
        assert time.monotonic() < deadline, "the scheduler did not come up"
        time.sleep(0.1)
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(scheduler_file)]
    options = ["--nthreads", "1", "--no-dashboard", "--host", "127.0.0.1"]
    processes += [subprocess.Popen([*worker, *options], **quiet) for _ in range(2)]
    yield json.loads(scheduler_file.read_text())["address"], processes
    for process in processes:
        process.kill()
        process.wait()


def test_a_worker_killed_in_mid_run_changes_nothing(
    cluster: tuple[str, list[subprocess.Popen[bytes]]],
) -> None:
    address, processes = cluster
    tasks = [task(f"t{k}", "slow", "slow") for k in range(60)]
    rows: dict[str, dict[str, Any]] = {}
    for count, row in enumerate(Dask(cluster="address", address=address, chunk=3).run(work, tasks)):
        rows[row["key"]] = row
        if count == 20:
            processes[1].kill()
    assert rows == by_key(Serial().run(work, tasks))


def test_the_slurm_job_script_says_what_it_must() -> None:
    pytest.importorskip("dask_jobqueue")
    knobs = {
        "queue": "short",
        "account": "lab",
        "cores": 1,
        "memory": "2GB",
        "walltime": "01:00:00",
        "interface": "lo",
    }
    executor = Dask(cluster="slurm", workers=1, slurm={**knobs, "job_extra_directives": ["--exclusive"]})
    from dask_jobqueue import SLURMCluster

    cluster = SLURMCluster(**executor.slurm_settings())
    script = cluster.job_script()
    cluster.close()
    for line in (
        "-p short",
        "-A lab",
        "-t 01:00:00",
        "--exclusive",
        "export OMP_NUM_THREADS=1",
        "--nthreads 1",
    ):
        assert line in script


@pytest.mark.parametrize(
    ("knobs", "words"),
    [
        ({"cluster": "cloud"}, "address, local, slurm"),
        ({"cluster": "address"}, "HOST:PORT"),
        ({"chunk": 0}, "at least"),
    ],
)
def test_senseless_knobs_are_refused(knobs: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Dask(**knobs)


def test_an_address_where_nobody_answers_is_one_message() -> None:
    with pytest.raises(InputError, match="no scheduler answers"):
        list(Dask(cluster="address", address="tcp://127.0.0.1:9").run(work, [task("a", "ok")]))
