"""Tasks whose cells behave as their solver says: for the executors' tests. Importable by workers."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Iterator
from typing import Any

from sysid_bench.nouns import Cell, Task


def task(name: str, *behaviours: str) -> Task:
    """A task with one cell per behaviour: ok, slow, hang, exit, die (by a segmentation fault), killed."""
    cells = tuple(Cell(f"{name}{k}", json.dumps(b), {"method": b}) for k, b in enumerate(behaviours))
    return Task("study", "identify", {}, 1, 0, {}, cells, name)


def work(task: Task) -> Iterator[dict[str, Any]]:
    for cell in task.cells:
        behaviour = json.loads(cell.solver)
        if behaviour in ("die", "killed"):
            os.kill(os.getpid(), signal.SIGSEGV if behaviour == "die" else signal.SIGKILL)
        if behaviour == "exit":
            os._exit(3)
        time.sleep({"hang": 60.0, "slow": 0.05}.get(behaviour, 0.0))
        yield task.row(cell, status="ok", reason="", value=len(cell.key) / 3)


class SlowStart:
    """`work`, by a worker whose imports take three seconds."""

    def __reduce__(self) -> tuple[Any, tuple[float]]:
        return after, (3.0,)


def after(seconds: float) -> Any:
    time.sleep(seconds)
    return work


def by_key(rows: Any) -> dict[str, dict[str, Any]]:
    return {row["key"]: row for row in rows}
