"""task -> rows. The story of a cell: acquire -> identify -> score, one row each."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench.build import build_cached
from sysid_bench.mechanics.fisher import Bound, crlb
from sysid_bench.nouns import (
    Acquired,
    Analysis,
    Cell,
    Diverged,
    Estimate,
    InputError,
    Method,
    Model,
    NotApplicable,
    Plant,
    Record,
    Task,
)
from sysid_bench.score import bound_columns, score

REASON_LENGTH = 300
CANNOT_KEEP = (
    "the record cannot be kept: "  # a row that says so stops a sweep: the next ones would say it too
)


@dataclass(frozen=True)
class Work:
    """`work(task)` yields the task's rows. records: which are kept in `folder` (none, first, all)."""

    records: str = "none"
    folder: str | None = None

    def __call__(self, task: Task) -> Iterator[dict[str, Any]]:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield from (_identify_rows(task, self) if task.kind == "identify" else _analysis_rows(task))

    def __post_init__(self) -> None:
        if self.records not in ("none", "first", "all"):
            raise InputError(f"records must be none, first or all; got {self.records!r}.")

    def keeps(self, task: Task) -> bool:
        return self.folder is not None and (
            self.records == "all" or (self.records == "first" and not task.repetition)
        )


def _failed(task: Task, cell: Cell, status: str, reason: str) -> dict[str, Any]:
    return task.row(cell, status=status, reason=" ".join(reason.split())[:REASON_LENGTH])


def _status_of(problem: Exception) -> tuple[str, str]:
    if isinstance(problem, NotApplicable):
        return "not_applicable", str(problem)
    if isinstance(problem, (Diverged, np.linalg.LinAlgError)):
        return "diverged", str(problem)
    return "error", f"{type(problem).__name__}: {problem}"


def _identify_rows(task: Task, work: Work) -> Iterator[dict[str, Any]]:
    try:
        plant = build_cached(task.parts["plant"], task.packages)
        acquired = acquire(task, plant)
        bound = bound_of(plant, acquired)
    except Exception as problem:
        _, reason = _status_of(problem)
        yield from (_failed(task, cell, "error", f"acquire: {reason}") for cell in task.cells)
        return
    if reason := _keep(acquired.record, task, work):
        yield from (_failed(task, cell, "error", reason) for cell in task.cells)
        return
    for cell in task.cells:
        yield _identify_row(task, cell, plant, acquired, bound)


def check_task(task: Task) -> None:
    """Build all that a task names and ask for its signal once, before the work. Raises InputError."""
    parts = {name: build_cached(text, task.packages) for name, text in task.parts.items()}
    for cell in task.cells:
        build_cached(cell.solver, task.packages)
    if "excitation" in parts:
        sampling, rng = parts["sampling"], np.random.default_rng(task.seed)
        parts["excitation"].signal(sampling.N, sampling.h_s, parts["plant"].nu, rng)


def acquire(task: Task, plant: Plant) -> Acquired:
    """The record of a task: made once, the same for every method."""
    parts = {name: build_cached(text, task.packages) for name, text in task.parts.items() if name != "plant"}
    rng = np.random.default_rng(task.seed)
    return parts["source"].acquire(plant, parts["excitation"], parts["noise"], parts["sampling"], rng)


def bound_of(plant: Plant, acquired: Acquired) -> Bound | None:
    """The Cramer-Rao bound of the very record; None where it is not defined (effects, no noise, singular)."""
    variance = acquired.noise_variance
    if not plant.is_linear or variance is None or not np.all(variance > 0):
        return None
    try:
        return crlb(plant, acquired.record, variance)
    except (np.linalg.LinAlgError, NotApplicable):
        return None


def _identify_row(
    task: Task, cell: Cell, plant: Plant, acquired: Acquired, bound: Bound | None
) -> dict[str, Any]:
    try:
        method = build_cached(cell.solver, task.packages)
        estimate = identify(
            method, acquired.record, plant.model() if method.nominal else plant.model().structure_only()
        )
        numbers = score(estimate, plant, acquired.record.h, bound)
    except Exception as problem:
        return _failed(task, cell, *_status_of(problem)) | bound_columns(bound)
    row = task.row(cell, nominal=method.nominal, status=estimate.status, reason=estimate.reason)
    row |= {"fit_s": estimate.seconds} | numbers
    return row | {f"diag.{name}": value for name, value in estimate.diagnostics.items() if np.isscalar(value)}


def identify(method: Method, record: Record, model: Model) -> Estimate:
    """method.fit, timed (s of wall clock). Raises what the method raises."""
    start = time.perf_counter()
    estimate = method.fit(record, model)
    return replace(estimate, seconds=time.perf_counter() - start)


def _analysis_rows(task: Task) -> Iterator[dict[str, Any]]:
    plant = build_cached(task.parts["plant"], task.packages)
    sampling = build_cached(task.parts["sampling"], task.packages)
    for cell in task.cells:
        start = time.perf_counter()
        try:
            analysis: Analysis = build_cached(cell.solver, task.packages)
            numbers = analysis.compute(plant, sampling, np.random.default_rng(task.seed))
        except Exception as problem:
            yield _failed(task, cell, *_status_of(problem))
            continue
        seconds = time.perf_counter() - start
        yield task.row(cell, status="ok", reason="", seconds=seconds) | dict(numbers)


def _keep(record: Record, task: Task, work: Work) -> str:
    """Write the record where it is wanted; says why where that does not go."""
    from sysid_bench.records import write_record

    if not work.keeps(task):
        return ""
    path = Path(str(work.folder)) / f"{task.record_key}.mcap"
    try:
        if not path.exists():
            write_record(record, path)
    except InputError as problem:
        return f"{CANNOT_KEEP}{problem}"
    return ""
