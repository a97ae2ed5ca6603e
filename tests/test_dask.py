"""The dask executor against a real scheduler and worker processes."""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from tasks import by_key, task, work

from sysid_bench.executors.serial import Serial
from sysid_bench.nouns import InputError

pytest.importorskip("distributed", reason="pip install 'sysid-bench[dask]'")
from distributed import Client

from sysid_bench.executors.dask import Dask


def test_a_local_cluster_gives_the_rows_of_serial_and_a_deadly_cell_is_a_row() -> None:
    tasks = [task(f"t{k}", "ok", "ok") for k in range(25)]
    rows = by_key(Dask(workers=2, chunk=4).run(work, [*tasks, task("x", "ok", "killed")]))
    dead = rows.pop("x1")
    assert dead["status"] == "error" and "Killed" in dead["reason"]
    assert rows.pop("x0")["status"] == "ok"
    assert rows == by_key(Serial().run(work, tasks))


class Cluster:
    """A scheduler and workers as processes of their own, each possibly within a network namespace."""

    def __init__(self, folder: Path, host: str) -> None:
        self.file, self.processes = folder / "scheduler.json", []
        self.start("scheduler", ["--host", host, "--port", "0", "--scheduler-file", str(self.file)])
        deadline = time.monotonic() + 60
        while not self.file.exists():
            assert time.monotonic() < deadline, "the scheduler did not come up"
            time.sleep(0.1)

    @property
    def address(self) -> str:
        return json.loads(self.file.read_text())["address"]

    def start(self, what: str, options: Sequence[str], within: Sequence[str] = ()) -> None:
        paths = [str(Path(__file__).parents[1]), str(Path(__file__).parent)]
        env = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(paths),
            "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "30 s",
        }
        command = [*within, sys.executable, "-m", f"distributed.cli.dask_{what}", "--no-dashboard", *options]
        quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.processes.append(subprocess.Popen(command, env=env, cwd=self.file.parent, **quiet))

    def add_worker(self, host: str, within: Sequence[str] = ()) -> None:
        self.start("worker", ["--scheduler-file", str(self.file), "--nthreads", "1", "--host", host], within)

    def close(self) -> None:
        for process in self.processes:
            process.kill()
            process.wait()


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    """With two workers on the loopback."""
    cluster = Cluster(tmp_path, "127.0.0.1")
    for _ in range(2):
        cluster.add_worker("127.0.0.1")
    yield cluster
    cluster.close()


BRIDGE, NET = "sysidbr0", "10.231.77"


def ip(*words: str) -> bool:
    return subprocess.run(["ip", *words], capture_output=True).returncode == 0


def remove_namespaces() -> None:
    ip("link", "del", BRIDGE)
    for k in (1, 2):
        ip("netns", "del", f"sysid{k}")


@pytest.fixture
def namespaces() -> Iterator[list[str]]:
    """Two network namespaces at one bridge, as two machines at one switch: addresses NET.11 and NET.12, ours NET.1."""
    if not shutil.which("ip"):
        pytest.skip("no `ip` here (Debian: iproute2)")
    remove_namespaces()
    made = ip("link", "add", BRIDGE, "type", "bridge") and ip("addr", "add", f"{NET}.1/24", "dev", BRIDGE)
    made = made and ip("link", "set", BRIDGE, "up")
    for k in (1, 2):
        name, ours, theirs = f"sysid{k}", f"sysidv{k}", "eth0"
        made = made and ip("netns", "add", name)
        made = made and ip("link", "add", ours, "type", "veth", "peer", "name", theirs, "netns", name)
        made = made and ip("link", "set", ours, "master", BRIDGE, "up")
        made = made and ip("-n", name, "addr", "add", f"{NET}.{10 + k}/24", "dev", theirs)
        made = (
            made and ip("-n", name, "link", "set", theirs, "up") and ip("-n", name, "link", "set", "lo", "up")
        )
    if not made:
        remove_namespaces()
        pytest.skip("network namespaces cannot be made here (that takes root)")
    yield ["sysid1", "sysid2"]
    remove_namespaces()


def workers_at(address: str, count: int) -> list[str]:
    """Addresses of the workers, once they are all there."""
    with Client(address, timeout=120) as client:
        client.wait_for_workers(count, timeout=300)
        return sorted(client.scheduler_info()["workers"])


def test_a_worker_killed_in_mid_run_changes_nothing(cluster: Cluster) -> None:
    tasks = [task(f"t{k}", "slow", "slow") for k in range(60)]
    rows: dict[str, dict[str, Any]] = {}
    for count, row in enumerate(Dask(cluster="address", address=cluster.address, chunk=3).run(work, tasks)):
        rows[row["key"]] = row
        if count == 20:
            cluster.processes[1].kill()
    assert rows == by_key(Serial().run(work, tasks))


@pytest.mark.slow
def test_workers_on_other_machines_and_one_of_them_lost(tmp_path: Path, namespaces: list[str]) -> None:
    """A cable is pulled: nothing tells the scheduler, which waits for a heartbeat; the table is that of one process."""
    cluster = Cluster(tmp_path, f"{NET}.1")
    for k, name in enumerate(namespaces, 11):
        cluster.add_worker(f"{NET}.{k}", within=["ip", "netns", "exec", name])
    try:
        hosts = [address.split("//")[1].split(":")[0] for address in workers_at(cluster.address, 2)]
        assert hosts == [f"{NET}.11", f"{NET}.12"]
        tasks = [task(f"t{k}", "slow", "slow") for k in range(60)]
        rows: dict[str, dict[str, Any]] = {}
        for count, row in enumerate(
            Dask(cluster="address", address=cluster.address, chunk=3).run(work, tasks)
        ):
            rows[row["key"]] = row
            if count == 20:
                ip("-n", namespaces[0], "link", "set", "eth0", "down")
                cluster.processes[1].kill()
        assert rows == by_key(Serial().run(work, tasks))
    finally:
        cluster.close()


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
