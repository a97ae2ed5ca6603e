"""tasks -> rows, by worker processes of this machine; a worker that dies or hangs costs one cell."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import wait
from typing import Any

from sysid_bench.nouns import InputError, Task

Rows = Callable[[Task], Iterator[dict[str, Any]]]
AHEAD = 2  # tasks handed to a worker: one at work, one waiting in its pipe
POLL_S = 0.5
START_S = 300.0  # for a worker's imports on a machine that is busy: no cell's time
UP = "up"  # a worker's first word


@dataclass
class _Worker:
    process: Any
    pipe: Any  # a Connection; on Windows a PipeConnection
    tasks: deque[Task] = field(default_factory=deque)
    since: float = field(default_factory=lambda: time.monotonic() + START_S)


@dataclass(frozen=True)
class Local:
    """Worker processes started fresh (spawn), one task ahead each.

    workers         processes; None: one per core that this process may use
    cell_timeout_s  wall clock for one cell, acquisition included; its worker is then killed
    """

    workers: int | None = None
    cell_timeout_s: float = 300.0

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 1:
            raise InputError(f"executor.workers must be at least 1 or null; got {self.workers}.")
        if not self.cell_timeout_s > 0:
            raise InputError(f"executor.cell_timeout_s must be positive; got {self.cell_timeout_s}.")

    def run(self, work: Rows, tasks: Iterable[Task]) -> Iterator[dict[str, Any]]:
        """Rows as they come. A dead worker's cell gets status error, a hanging one's timeout."""
        count = self.workers or len(os.sched_getaffinity(0))
        todo, pool = iter(tasks), []
        lost: deque[Task] = deque()
        try:
            pool = [_start(work) for _ in range(count)]
            while True:
                for worker in pool:
                    _feed(worker, lost, todo)
                busy = [worker for worker in pool if worker.tasks]
                if not busy:
                    return
                yield from self._collect(pool, busy, lost, work)
        finally:
            for worker in pool:
                _stop(worker)

    def _collect(
        self, pool: list[_Worker], busy: list[_Worker], lost: deque[Task], work: Rows
    ) -> Iterator[dict[str, Any]]:
        ready = set(wait([worker.pipe for worker in busy], timeout=POLL_S))
        for worker in busy:
            if worker.pipe in ready:
                try:
                    yield from _received(worker)
                    continue
                except (EOFError, ConnectionResetError):
                    reason = "error", _death(worker)
            elif time.monotonic() - worker.since > self.cell_timeout_s:
                reason = "timeout", f"longer than executor.cell_timeout_s = {self.cell_timeout_s:g} s"
            else:
                continue
            yield from _buried(worker, lost, *reason)
            pool[pool.index(worker)] = _start(work)


def _feed(worker: _Worker, lost: deque[Task], todo: Iterator[Task]) -> None:
    while len(worker.tasks) < AHEAD:
        task = lost.popleft() if lost else next(todo, None)
        if task is None:
            return
        if not worker.tasks:
            worker.since = max(worker.since, time.monotonic())
        worker.tasks.append(task)
        try:
            worker.pipe.send(task)
        except (BrokenPipeError, ConnectionResetError):
            return  # its death is seen, and its tasks taken back, at the next collect


def _received(worker: _Worker) -> Iterator[dict[str, Any]]:
    """What the worker has sent: that it is up, a row, or None where a task is done."""
    row = worker.pipe.recv()
    worker.since = time.monotonic()
    if row == UP:
        return
    if row is None:
        worker.tasks.popleft()
        return
    worker.tasks[0] = worker.tasks[0].without({row["key"]})
    yield row


def _buried(worker: _Worker, lost: deque[Task], status: str, reason: str) -> Iterator[dict[str, Any]]:
    """The row of the cell that killed its worker; the rest of its tasks goes back to the others."""
    _stop(worker)
    task, *others = worker.tasks
    if task.cells:
        culprit = task.cells[0]
        yield task.row(culprit, status=status, reason=reason)
        task = task.without({culprit.key})
    lost.extend(t for t in (task, *others) if t.cells)


def _death(worker: _Worker) -> str:
    worker.process.join(timeout=5)
    code = worker.process.exitcode
    if code is not None and code < 0:
        return f"its process was ended by {signal.Signals(-code).name}"
    return f"its process ended with exit code {code}"


def _start(work: Rows) -> _Worker:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs, work), daemon=True)
    process.start()
    theirs.close()
    return _Worker(process, ours)


def _stop(worker: _Worker) -> None:
    worker.pipe.close()
    worker.process.kill()
    worker.process.join()


def _work(pipe: Any, work: Rows) -> None:
    """A worker's life: task in, rows out, None when done; ends when the parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        pipe.send(UP)
        while True:
            for row in work(pipe.recv()):
                pipe.send(row)
            pipe.send(None)
