"""tasks -> rows, on many machines by dask.distributed: a given scheduler, a local cluster, or Slurm."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from sysid_bench.nouns import InputError, Task

Rows = Callable[[Task], Iterator[dict[str, Any]]]
KINDS = ("address", "local", "slurm")
WORKER_ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


@dataclass(frozen=True)
class Dask:
    """Chunks of tasks on dask workers, one thread each; only the parent writes results.

    cluster         address (a scheduler that runs), local (worker processes here), slurm (dask-jobqueue)
    address         host:port of the scheduler, for cluster=address
    workers         worker processes, for local and slurm
    chunk           tasks per dask task: a dask task costs milliseconds, a cell may cost less
    ahead           chunks in flight per worker; more tasks wait unsent, so the parent's memory stays flat
    allowed_failures  workers that one chunk may take down before its cells become rows with status error
    slurm           settings of dask_jobqueue.SLURMCluster (queue, account, cores, memory, walltime, ...)
    """

    cluster: str = "local"
    address: str | None = None
    workers: int = 2
    chunk: int = 10
    ahead: int = 3
    allowed_failures: int = 1
    slurm: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.cluster not in KINDS:
            raise InputError(f"executor.cluster must be one of {', '.join(KINDS)}; got {self.cluster!r}.")
        if self.cluster == "address" and not self.address:
            raise InputError("executor.cluster=address needs executor.address=HOST:PORT of a scheduler.")
        if min(self.workers, self.chunk, self.ahead) < 1:
            raise InputError("executor.workers, chunk and ahead must be at least 1.")

    def run(self, work: Rows, tasks: Iterable[Task]) -> Iterator[dict[str, Any]]:
        """Rows as chunks finish. Chunks that lost their workers are run again at the end, cell by cell and one
        at a time: so the cell that kills is told from those that only waited beside it."""
        with self._client() as client:
            suspects: list[Task] = []
            yield from self._all_at_once(client, work, _chunks(tasks, self.chunk), suspects)
            for suspect in suspects:
                future = client.submit(_rows, work, [suspect], pure=False)
                problem = future.exception()
                yield from [_lost(suspect, problem)] if problem else future.result()

    def _all_at_once(
        self, client: Any, work: Rows, chunks: Iterator[list[Task]], suspects: list[Task]
    ) -> Iterator[dict[str, Any]]:
        from distributed import as_completed

        def submitted(chunk: list[Task]) -> Any:
            future = client.submit(_rows, work, chunk, pure=False)
            running[future] = chunk
            return future

        running: dict[Any, list[Task]] = {}
        first = [submitted(chunk) for chunk in islice(chunks, self.ahead * max(self._size(client), 1))]
        finished = as_completed(first)
        for future in finished if first else ():
            chunk = running.pop(future)
            if future.status == "finished":
                yield from future.result()
            else:
                suspects += [part for task in chunk for part in _split(task)]
            for more in islice(chunks, 1):
                finished.add(submitted(more))

    def _size(self, client: Any) -> int:
        return self.workers if self.cluster == "slurm" else len(client.scheduler_info()["workers"])

    @contextmanager
    def _client(self) -> Iterator[Any]:
        try:
            import dask.config
            from distributed import Client
        except ImportError:
            raise InputError("executor=dask needs dask: pip install 'sysid-bench[dask]'.") from None
        with dask.config.set({"distributed.scheduler.allowed-failures": self.allowed_failures}):
            if self.cluster == "address":
                with _connected(Client, str(self.address)) as client:
                    yield client
            else:
                with self.made_cluster() as cluster, Client(cluster) as client:
                    yield client

    def made_cluster(self) -> Any:
        """The cluster of kind local or slurm; bound to loopback where local."""
        if self.cluster == "local":
            from distributed import LocalCluster

            no_dashboard: Any = None  # what distributed takes, though its signature says str
            return LocalCluster(
                n_workers=self.workers, threads_per_worker=1, host="127.0.0.1", dashboard_address=no_dashboard,
                env=WORKER_ENVIRONMENT,
            )  # fmt: skip
        try:
            from dask_jobqueue.slurm import SLURMCluster
        except ImportError:
            raise InputError(
                "executor.cluster=slurm needs dask-jobqueue: pip install 'sysid-bench[dask]'."
            ) from None
        cluster = SLURMCluster(**self.slurm_settings())
        cluster.scale(jobs=self.workers)
        return cluster

    def slurm_settings(self) -> dict[str, Any]:
        """What SLURMCluster is given: the user's settings, and one BLAS thread per worker."""
        exports = [f"export {name}={value}" for name, value in WORKER_ENVIRONMENT.items()]
        return {"job_script_prologue": exports, **self.slurm}


def _connected(client_class: Any, address: str) -> Any:
    try:
        return client_class(address, timeout=10)
    except (OSError, ValueError) as problem:
        raise InputError(f"executor.address={address}: no scheduler answers there ({problem}).") from None


def _chunks(tasks: Iterable[Task], size: int) -> Iterator[list[Task]]:
    iterator = iter(tasks)
    while chunk := list(islice(iterator, size)):
        yield chunk


def _rows(work: Rows, tasks: list[Task]) -> list[dict[str, Any]]:
    return [row for task in tasks for row in work(task)]


def _split(task: Task) -> Iterator[Task]:
    keys = {cell.key for cell in task.cells}
    for key in (cell.key for cell in task.cells):
        yield task.without(keys - {key})


def _lost(task: Task, problem: BaseException | None) -> dict[str, Any]:
    reason = " ".join(str(problem).split())[:200]
    return task.row(task.cells[0], status="error", reason=f"{type(problem).__name__}: {reason}")
