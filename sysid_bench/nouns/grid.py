"""The grid of a study: cells (one row each) in tasks (one record each), what fills them and what runs them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from sysid_bench.nouns.experiment import Sampling
from sysid_bench.nouns.plant import Plant


class Analysis(Protocol):
    """A numerical study without a record: one cell of numbers from settings and a seed."""

    def compute(self, plant: Plant, sampling: Sampling, rng: np.random.Generator) -> Mapping[str, float]: ...


@dataclass(frozen=True)
class Cell:
    """One row to be: what answers (a method or an analysis), its labels and its key."""

    key: str
    solver: str
    labels: Mapping[str, Any]


@dataclass(frozen=True)
class Task:
    """One record, acquired once, and the cells that use it.

    parts: group -> JSON text of the node (workers build objects from it); seed: of the record.
    """

    study: str
    kind: str
    parts: Mapping[str, str]
    seed: int
    repetition: int
    labels: Mapping[str, Any]
    cells: tuple[Cell, ...]
    record_key: str
    packages: tuple[str, ...] = ()

    def row(self, cell: Cell, **columns: Any) -> dict[str, Any]:
        """A row of one cell: its labels and `columns`."""
        return {"key": cell.key, "study": self.study, **cell.labels, "seed": self.seed, **columns}

    def without(self, keys: set[str]) -> Task:
        """The same task with only those cells whose key is not in `keys`."""
        cells = tuple(cell for cell in self.cells if cell.key not in keys)
        return replace(self, cells=cells)


class Executor(Protocol):
    """Runs `work(task)`, which yields one row per cell, for every task; yields rows as they come, in any order."""

    def run(
        self, work: Callable[[Task], Iterator[dict[str, Any]]], tasks: Iterable[Task]
    ) -> Iterator[dict[str, Any]]: ...
