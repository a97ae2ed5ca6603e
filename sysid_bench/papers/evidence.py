"""results folder -> the tables that claims are judged on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench.nouns import Array, InputError
from sysid_bench.table import read_table


@dataclass(frozen=True)
class Table:
    """Rows of one study, by column. `study` names it in messages."""

    study: str
    columns: Mapping[str, np.ndarray]

    @cached_property
    def rows(self) -> int:
        return len(next(iter(self.columns.values())))

    @property
    def runs(self) -> int:
        """Different records (or draws) among these rows, at one point of the grid."""
        return len(np.unique(self.columns["repetition"]))

    def at(self, **where: Any) -> Table:
        """The rows whose columns have these values; `sampling__h_s` names the column sampling.h_s.

        Raises InputError where there is none: the study was run in part.
        """
        keep = np.ones(self.rows, dtype=bool)
        for name, value in where.items():
            keep &= _equal(self.column(name), value)
        if not keep.any():
            words = " ".join(f"{k.replace('__', '.')}={v}" for k, v in where.items())
            raise InputError(f"the table of {self.study} has no rows with {words}; run the whole study.")
        return Table(self.study, {name: values[keep] for name, values in self.columns.items()})

    def column(self, name: str) -> np.ndarray:
        name = name.replace("__", ".")
        if name not in self.columns:
            raise InputError(f"the table of {self.study} has no column {name}; run the study again.")
        return self.columns[name]

    def values(self, name: str) -> Array:
        """One number per run; a run without an estimate counts as infinitely wrong."""
        found = self.column(name).astype(float)
        return np.where(np.isfinite(found), found, np.inf)

    def median(self, name: str) -> float:
        return float(np.median(self.values(name)))

    def points(self, name: str) -> list[float]:
        """Different numbers of one column, rising."""
        return sorted(float(x) for x in np.unique(self.column(name)))

    def curve(self, name: str, along: str = "sampling.h_s") -> tuple[Array, Array]:
        """(points, medians) of one column along another."""
        points = self.points(along)
        key = along.replace(".", "__")
        return np.array(points), np.array([self.at(**{key: x}).median(name) for x in points])


@dataclass(frozen=True)
class Tables:
    """The tables under a results folder, read once each."""

    folder: Path
    _read: dict[str, Table] = field(default_factory=dict)

    def __getitem__(self, study: str) -> Table:
        if study not in self._read:
            path = self._path(study)
            if not path.is_file():
                raise InputError(f"{path} is missing; make it with: {command(study)}")
            self._read[study] = Table(study, read_table(path))
        return self._read[study]

    def missing(self, studies: list[str]) -> list[str]:
        return [s for s in studies if not self._path(s).is_file()]

    def _path(self, study: str) -> Path:
        return self.folder / experiment(study) / "table.parquet"


def slope(table: Table, name: str, along: str, low: float, high: float) -> float:
    """Exponent of the medians of one column between two points of another."""
    key = along.replace(".", "__")
    ends = [table.at(**{key: x}).median(name) for x in (low, high)]
    return float(np.log(ends[1] / ends[0]) / np.log(high / low))


PAPERS = {
    "kapucu_baysec_1997": ("fig2_5", "fall", "identifiability", "record_length", "response"),
    "bruschetta_2011": (
        "bias", "discretisation", "energy", "fig3_1", "fig3_2", "fig5_10_13", "fig5_14_15", "fig5_2_5", "fig5_6_9",
        "figA_1", "hidden_step", "horizon", "passivity", "zoh_input",
    ),
}  # fmt: skip


def experiment(study: str) -> str:
    """folder/name of a study, as `experiment=` takes it and as its results folder is called."""
    folder = next(paper for paper, studies in PAPERS.items() if study in studies)
    return f"{folder}/{study}"


def command(study: str) -> str:
    """The command line that makes a study's table."""
    return f"sysid-bench sweep experiment={experiment(study)}"


def _equal(values: np.ndarray, wanted: Any) -> np.ndarray:
    if isinstance(wanted, str):
        return np.array([str(value) == wanted for value in values])
    return np.isclose(values.astype(float), float(wanted), rtol=1e-6, atol=0)
