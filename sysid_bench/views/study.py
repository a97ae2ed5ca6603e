"""study folder -> Study: its manifest and its table as columns; and the view files written beside them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench.nouns import InputError
from sysid_bench.table import read_table

Columns = Mapping[str, np.ndarray]
OPTIONS = ("plant", "analysis", "excitation", "noise", "source", "method")


@dataclass(frozen=True)
class Study:
    """A finished study: folder, manifest (dict), columns (name -> (rows,) array)."""

    folder: Path
    manifest: Mapping[str, Any]
    columns: Columns

    @property
    def name(self) -> str:
        return str(self.manifest.get("study") or self.folder.name)

    @property
    def config(self) -> Mapping[str, Any]:
        """The resolved configuration: study, axes, cases, figures and every group."""
        return self.manifest.get("config") or {}

    @property
    def rows(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    @property
    def axes(self) -> tuple[str, ...]:
        """Columns that tell cells apart: what the study sweeps, and options and knobs with several values."""
        swept = [key for key in self.config.get("axes") or {} if key in self.columns]
        cased = [key for case in self.config.get("cases") or [] for key in case if key in self.columns]
        named = [key for key in dict.fromkeys([*OPTIONS, *cased, *swept]) if key in self.columns]
        return tuple(key for key in named if len(self.order(key)) > 1 or key in swept)

    def order(self, column: str) -> list[Any]:
        """Values of one column: in the order of the study's axes where it says one, else numbers rising,
        words as they come."""
        values = self.columns[column]
        if values.dtype.kind in "fiu":
            return sorted(set(values[np.isfinite(values)]))
        named = [str(v) for v in (self.config.get("axes") or {}).get(column, [])]
        named += [str(case[column]) for case in self.config.get("cases") or [] if column in case]
        found = dict.fromkeys(str(v) for v in values)
        return [v for v in dict.fromkeys(named) if v in found] + [v for v in found if v not in named]


def read_study(folder: str | Path) -> Study:
    """Read manifest.json and table.parquet of a study folder. Raises InputError where one is missing."""
    folder = Path(folder)
    for name in ("manifest.json", "table.parquet"):
        if not (folder / name).is_file():
            raise InputError(
                f"{folder} is no finished study: {name} is missing. Give a folder that `sysid-bench sweep` wrote."
            )
    manifest = json.loads((folder / "manifest.json").read_text())
    table = read_table(folder / "table.parquet")
    return Study(folder, manifest, {name: _filled(column) for name, column in table.items()})


def _filled(column: np.ndarray) -> np.ndarray:
    """Missing words are empty ones."""
    words = column.dtype.kind == "O"
    return np.array(["" if v is None else v for v in column], dtype=object) if words else column


def where(columns: Columns, wanted: Mapping[str, Any]) -> np.ndarray:
    """(rows,) bool: rows whose columns have the wanted value, or one of a list of values.

    Raises InputError for a column that the table does not have.
    """
    mask = np.ones(len(next(iter(columns.values()))), dtype=bool)
    for key, value in wanted.items():
        column, values = column_of(columns, key), value if isinstance(value, list | tuple) else [value]
        mask &= np.logical_or.reduce([_equals(column, v) for v in values])
    return mask


def _equals(column: np.ndarray, value: Any) -> np.ndarray:
    if column.dtype.kind in "fiu":
        return np.isclose(column, float(value), rtol=1e-9, atol=0.0)
    return np.array([str(v) == str(value) for v in column], dtype=bool)


def column_of(columns: Columns, name: str) -> np.ndarray:
    """One column by name. Raises InputError with the names that there are."""
    if name not in columns:
        raise InputError(f"the table has no column {name!r}; it has: {', '.join(sorted(columns))}.")
    return columns[name]


def numbers_of(columns: Columns, name: str) -> np.ndarray:
    """One column of numbers. Raises InputError where it holds words."""
    if (column := column_of(columns, name)).dtype.kind not in "fiu":
        raise InputError(f"column {name!r} holds words, such as {column[0]!r}; a figure's y wants numbers.")
    return column


def has_value(columns: Columns, name: str) -> np.ndarray:
    """(rows,) bool: False where the row's option does not have this knob."""
    column = column_of(columns, name)
    return np.isfinite(column) if column.dtype.kind in "fiu" else column != ""


def failed(columns: Columns) -> np.ndarray:
    """(rows,) bool: no estimate although the method applies (diverged, timeout, error)."""
    return ~np.isin(columns["status"], ("ok", "not_applicable"))


@dataclass(frozen=True)
class Curve:
    """One column against x over the runs at each x; every field (nx,).

    x, median, low (10 %), high (90 %) of the runs with a finite value; runs that apply; missing: runs
    among them without one. The median is NaN where no run has a value.
    """

    x: np.ndarray
    median: np.ndarray
    low: np.ndarray
    high: np.ndarray
    runs: np.ndarray
    missing: np.ndarray


def curve(columns: Columns, x: str, y: str, rows: np.ndarray) -> Curve:
    """Medians and 10-90 % quantiles of column y at each value of column x, over the rows (bool mask)."""
    applies = rows & (columns["status"] != "not_applicable") & has_value(columns, x)
    xs, ys = column_of(columns, x)[applies], numbers_of(columns, y)[applies]
    good = (columns["status"][applies] == "ok") & np.isfinite(ys)
    places = sorted(set(xs))
    return Curve(
        np.array(places), *np.array([_at(ys[xs == p], good[xs == p]) for p in places]).reshape(-1, 5).T
    )


def _at(ys: np.ndarray, good: np.ndarray) -> Sequence[float]:
    low, median, high = np.quantile(ys[good], (0.1, 0.5, 0.9)) if good.any() else (np.nan,) * 3
    return median, low, high, len(ys), int(np.count_nonzero(~good))


def write_views(study_dir: str | Path) -> list[Path]:
    """Write figures, report.html and study.rrd of a study folder; returns the paths written."""
    from sysid_bench.views.figures import write_figures
    from sysid_bench.views.report import write_report
    from sysid_bench.views.rerun_study import write_study_rrd

    study = read_study(study_dir)
    figures = write_figures(study)
    return [*figures, write_report(study, figures), write_study_rrd(study, figures)]


def write_index(results_dir: str | Path) -> Path:
    """Write results_dir/index.html over all study folders below it; returns its path."""
    from sysid_bench.views.index import write_index_page

    return write_index_page(Path(results_dir))
