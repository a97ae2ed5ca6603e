"""What the engine adds to a cell: processor time and memory of the parent, of dask's scheduler; scaling over cores; and what
10^6 cells on 1000 cores would take by these figures. Processor time, so that a busy machine does not count.

python benchmarks/engine.py [cells ...]       the largest is 10^4 by default; 10^5 takes minutes
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
PLUGIN = (
    REPOSITORY / "tests" / "trivial_plugin"
)  # cells that cost nothing, so that the engine is what is measured
CHUNK = 10
TICKS = os.sysconf("SC_CLK_TCK")
CORES, CELLS, PRICE = 1000, 10**6, 0.05  # price: of a core for an hour, in the currency of your bill


@dataclass(frozen=True)
class Used:
    """Of one process: wall s, processor s of its own, MiB at most; processor s of each of its workers."""

    wall: float
    own: float
    peak: float
    workers: tuple[float, ...] = ()


def trivial(folder: Path, cells: int, executor: str, *more: str) -> Used:
    """A sweep of cells that cost nothing, through the command line."""
    words = [
        f"plugins={PLUGIN}", f"study.name={executor}_{cells}", "study.kind=analysis", "analysis=nothing",
        f"study.repetitions={cells}", f"executor={executor}", *more,
    ]  # fmt: skip
    return sweep(folder, *words)


def sweep(folder: Path, *words: str) -> Used:
    command = [sys.executable, "-m", "sysid_bench", "sweep", "views=false", *words]
    start = time.perf_counter()
    process = subprocess.Popen(command, cwd=folder, env=environment(), stdout=subprocess.DEVNULL)
    own = peak = 0.0
    workers: dict[int, float] = {}
    while process.poll() is None:
        own, peak = max(own, own_seconds(process.pid)), max(peak, peak_mib(process.pid))
        workers |= {pid: own_seconds(pid) or workers.get(pid, 0.0) for pid in workers_of(process.pid)}
        time.sleep(0.02)
    assert process.returncode == 0
    return Used(time.perf_counter() - start, own, peak, tuple(workers.values()))


def workers_of(pid: int) -> list[int]:
    """Worker processes of a sweep: children that multiprocessing spawned to work, not to keep books."""
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        return [
            int(child) for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()
        ]
    except OSError:
        return []


def environment() -> dict[str, str]:
    paths = os.pathsep.join([str(REPOSITORY), str(PLUGIN)])
    return {**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def own_seconds(pid: int) -> float:
    """Processor time of a process without its children."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / TICKS


def peak_mib(pid: int) -> float:
    try:
        found = re.search(r"VmHWM:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text())
    except OSError:
        return 0.0
    return int(found[1]) / 1024 if found else 0.0


def overhead(folder: Path, executor: str, counts: list[int], *more: str) -> float:
    """Prints, and returns the parent's processor s per cell at the largest count."""
    one = trivial(folder, 1, executor, *more)
    print(
        f"{executor}: one cell {one.wall:.1f} s, parent {one.own:.1f} s of processor time, {one.peak:.0f} MiB"
    )
    each = 0.0
    for cells in counts:
        used = trivial(folder, cells, executor, *more)
        each = (used.own - one.own) / cells
        print(
            f"{executor}: {cells} cells in {used.wall:.1f} s ({cells / used.wall:.0f}/s); parent {1e3 * each:.2f} ms of "
            f"processor time a cell, at most {used.peak:.0f} MiB",
            flush=True,
        )
    return each


@contextmanager
def dask_cluster(folder: Path) -> Iterator[tuple[str, int]]:
    """(address, pid) of a scheduler with two workers, each a process of its own."""
    file = folder / "scheduler.json"

    def start(what: str, *options: str) -> subprocess.Popen[bytes]:
        command = [
            sys.executable,
            "-m",
            f"distributed.cli.dask_{what}",
            "--no-dashboard",
            "--host",
            "127.0.0.1",
        ]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return subprocess.Popen(
            [*command, "--scheduler-file", str(file), *options], cwd=folder, env=environment(), **quiet
        )

    processes = [start("scheduler", "--port", "0")]
    while not file.exists():
        time.sleep(0.1)
    processes += [start("worker", "--nthreads", "1") for _ in range(2)]
    yield json.loads(file.read_text())["address"], processes[0].pid
    for process in processes:
        process.kill()
        process.wait()


def through_dask(folder: Path, cells: int) -> tuple[float, float]:
    """Processor s of the parent per cell, and of the scheduler per dask task."""
    with dask_cluster(folder) as (address, pid):
        words = ["executor.cluster=address", f"executor.address={address}", f"executor.chunk={CHUNK}"]
        before = own_seconds(pid)
        parent = overhead(folder, "dask", [cells], *words)
        scheduler = (own_seconds(pid) - before) / (cells / CHUNK)
    print(f"dask: scheduler {1e3 * scheduler:.2f} ms of processor time per dask task of {CHUNK} cells")
    return parent, scheduler


def scaling(folder: Path) -> float:
    """Prints how the processor time of a real study parts over one and two workers, and their wall time; returns
    the processor s of one of its cells.

    On a machine with other work the wall tells of that work. What binds on free cores is the busiest process: so the
    ratio of the busiest workers is the speed-up that two free cores give.
    """
    words = ["experiment=reference/paired", "study.repetitions=8", "records=none"]
    runs = {n: sweep(folder, *words, f"executor.workers={n}", f"results_dir=w{n}") for n in (1, 2)}
    cells = 8 * 3 * 9
    for n, used in runs.items():
        shares = " and ".join(f"{seconds:.1f}" for seconds in used.workers)
        print(
            f"{cells} real cells over {n} worker(s): {shares} s of processor time in the workers, {used.own:.1f} in the parent; "
            f"{used.wall:.1f} s of wall at load {os.getloadavg()[0]:.1f}"
        )
    gain = max(runs[1].workers) / max(runs[2].workers)
    print(f"the busiest of two workers has 1/{gain:.2f} of the work of one")
    one = sweep(
        folder, *words[:1], "study.repetitions=1", "records=none", "executor=serial", "results_dir=s1"
    )
    many = sweep(folder, *words, "executor=serial", "results_dir=s8")
    each = (many.own - one.own) / (cells * 7 / 8)
    print(f"a real cell (mean over the methods of reference/paired): {1e3 * each:.0f} ms of processor time")
    return each


def project(cell: float, parent: float, scheduler: float) -> None:
    """What the largest of three bottlenecks says of 10^6 cells on 1000 cores."""
    parts = {
        "the cells themselves": cell * CELLS / CORES,
        "the parent (rows in, one process)": parent * CELLS,
        "dask's scheduler (one process)": scheduler * CELLS / CHUNK,
    }
    for what, seconds in parts.items():
        print(f"{CELLS:.0e} cells on {CORES} cores: {what}: {seconds / 60:.1f} min")
    wall = max(parts.values())
    used = cell * CELLS / 3600
    print(
        f"so {wall / 60:.0f} min; {used:.0f} core-hours of work, {wall / 3600 * CORES:.0f} paid for: "
        f"{wall / 3600 * CORES * PRICE:.0f} at {PRICE} per core-hour"
    )


def main(counts: list[int]) -> None:
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for executor in ("serial", "local"):
            overhead(folder, executor, counts)
        parent, scheduler = through_dask(folder, counts[-1])
        project(scaling(folder), parent, scheduler)


if __name__ == "__main__":
    main([int(word) for word in sys.argv[1:]] or [1000, 10000])
