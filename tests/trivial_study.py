"""A study of many cells that cost nothing, run in forked processes: what a sweep survives, without its seconds of imports.

As a program: each line of stdin (a JSON list of words) is run like a command line; answers its pid, then its exit code.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil

from sysid_bench.table import read_table

REPOSITORY = Path(__file__).parents[1]
PLUGIN = REPOSITORY / "tests" / "trivial_plugin"  # the analysis of nothing, as a user's own package


def words(results: Path, cells: int, *more: str) -> list[str]:
    """The command line of the study."""
    fixed = [
        f"plugins={PLUGIN}",
        "study.name=trivial",
        "study.kind=analysis",
        "analysis=nothing",
        "views=false",
    ]
    return ["sweep", *fixed, f"study.repetitions={cells}", f"results_dir={results}", *more]


def table(results: Path) -> dict[str, list[str]]:
    """The finished table to the last bit, but for the seconds."""
    columns = read_table(results / "trivial" / "table.parquet")
    return {name: [repr(v) for v in column] for name, column in columns.items() if name != "seconds"}


class Runner:
    """Runs command lines in forked processes of one process that has imported everything."""

    def __init__(self, folder: Path) -> None:
        self.log = folder / f"log{len(list(folder.glob('log*')))}"
        env = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
        self.process = subprocess.Popen(
            [sys.executable, __file__, str(self.log)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=env, cwd=folder,
        )  # fmt: skip

    def start(self, line: list[str]) -> int:
        """The pid of the sweep."""
        assert self.process.stdin and self.process.stdout
        self.log.write_text("")
        self.process.stdin.write(json.dumps(line) + "\n")
        self.process.stdin.flush()
        return int(self.process.stdout.readline())

    def finish(self) -> int:
        """Exit code of the sweep; minus the signal that ended it."""
        assert self.process.stdout
        return int(self.process.stdout.readline())

    def run(self, line: list[str], meanwhile: Callable[[int], None] = lambda pid: None) -> int:
        meanwhile(self.start(line))
        return self.finish()

    def close(self) -> None:
        self.process.kill()
        self.process.wait()


def kill_after(seconds: float, worker: bool = False) -> Callable[[int], None]:
    """kill -9 of a sweep, or of one of its workers, after a while of its running (or of its having workers)."""

    def kill(pid: int) -> None:
        victims = [pid]
        start = time.monotonic()
        while psutil.pid_exists(pid):
            if worker and victims == [pid] and (victims := workers_of(pid) or [pid]) == [pid]:
                start = time.monotonic()
            if time.monotonic() - start > seconds:
                break
            time.sleep(0.005)
        with contextlib.suppress(ProcessLookupError):
            os.kill(victims[-1], signal.SIGKILL)

    return kill


def workers_of(pid: int) -> list[int]:
    """Worker processes of a sweep that runs."""
    try:
        children = psutil.Process(pid).children()
        return [child.pid for child in children if "spawn_main" in " ".join(child.cmdline())]
    except psutil.Error:
        return []


def serve(log: str) -> None:
    import sysid_bench.doors.sweep
    import sysid_bench.views.study  # noqa: F401
    from sysid_bench import conf
    from sysid_bench.__main__ import main

    conf.compose("sweep")
    for line in sys.stdin:
        pid = os.fork()
        if pid == 0:
            os.dup2(os.open(log, os.O_WRONLY | os.O_APPEND), 1)
            os.dup2(1, 2)
            code = main(json.loads(line))
            sys.stdout.flush()
            os._exit(code)
        print(pid, flush=True)
        print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)


if __name__ == "__main__":
    serve(sys.argv[1])
