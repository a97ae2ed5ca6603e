"""table + figure spec -> publication figures, PNG at 200 dpi and SVG (the spec: docs/figures.md)."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench.views.panel import BOUND, draw_panel, label_of, series_values
from sysid_bench.views.spec import Figure, axis_label, study_figures
from sysid_bench.views.strip import draw_failures
from sysid_bench.views.study import Study, failed, has_value, where
from sysid_bench.views.style import publication, save


def write_figures(study: Study) -> list[Path]:
    """Write every figure of the study into its folder figures/; returns the paths, PNG before SVG."""
    paths: list[Path] = []
    for spec in study_figures(study):
        with publication() as plt:
            paths += save(draw(plt, study, spec), study.folder / "figures", spec.name)
    return paths


def draw(plt: Any, study: Study, spec: Figure) -> Any:
    """One matplotlib figure from its spec. Raises InputError where it names a column that is not there."""
    mask = where(study.columns, spec.where)
    series = series_values(study, spec, mask)
    columns = spec.columns or {1: 1, 2: 2, 4: 2}.get(len(spec.panels), 3)
    figure, axes, strips = _lay_out(plt, study, spec, mask, columns)
    handles: dict[str, Any] = {}
    for axis, panel in zip(axes, spec.panels):
        handles |= draw_panel(axis, study, spec, panel, mask & where(study.columns, panel.where), series)
    for j, strip in enumerate(strips):
        below = [mask & where(study.columns, p.where) for p in spec.panels[j::columns]]
        draw_failures(strip, study, spec, np.logical_or.reduce(below), series)
    _name_x(figure, study, spec, axes, strips, columns)
    _words(figure, study, spec, mask, handles)
    return figure


def _lay_out(plt: Any, study: Study, spec: Figure, mask: np.ndarray, columns: int) -> tuple[Any, list, list]:
    rows = -(-len(spec.panels) // columns)
    strip = bool((failed(study.columns) & mask).any())
    width = {1: 5.4, 2: 7.4}.get(columns, 9.6)
    figure = plt.figure(figsize=(width, 2.45 * rows + 1.25 + 0.75 * strip), layout="constrained")
    grid = figure.add_gridspec(rows + strip, columns, height_ratios=[1.0] * rows + [0.22] * strip)
    axes = [figure.add_subplot(grid[i // columns, i % columns]) for i in range(len(spec.panels))]
    strips = [figure.add_subplot(grid[rows, j], sharex=axes[j]) for j in range(columns)] if strip else []
    return figure, axes, strips


def _name_x(figure: Any, study: Study, spec: Figure, axes: list, strips: list, columns: int) -> None:
    last = strips or axes[-columns:]
    for axis in axes + strips:
        if study.columns[spec.x].dtype.kind not in "fiu":
            places = study.order(spec.x)
            axis.set_xticks(
                range(len(places)), [str(p).replace("_", " ") for p in places], rotation=20, ha="right"
            )
            axis.set_xlim(-0.4, len(places) - 0.6)
        if axis not in last and strips:
            axis.tick_params(labelbottom=False)
    for axis in last:
        axis.set_xlabel(spec.x_label or axis_label(spec.x))


def _words(figure: Any, study: Study, spec: Figure, mask: np.ndarray, handles: dict[str, Any]) -> None:
    last = [k for k in handles if k in (label_of(spec, BOUND), label_of(spec, "theory"))]
    entries = {k: handles[k] for k in [*(k for k in handles if k not in last), *last]}
    if entries:
        room = int(13 * figure.get_figwidth() / (6 + max(len(words) for words in entries)))
        ncols = max(1, min(room, len(entries)))
        figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=ncols)
    head(figure, spec.title, runs_line(study, spec, mask))


def head(figure: Any, title: str, line: str) -> None:
    """Title and one grey line under it, at the left edge; the invisible suptitle keeps their room free."""
    figure.suptitle("\n" if title else " ", fontsize=10)
    inch = 1 / figure.get_figheight()
    figure.text(0.008, 1 - 0.05 * inch, title, fontsize=10.5, va="top")
    figure.text(0.008, 1 - (0.27 if title else 0.05) * inch, line, fontsize=7.5, color="#555555", va="top")


def runs_line(study: Study, spec: Figure, mask: np.ndarray) -> str:
    """What the marks are: how many runs, which quantiles, what an open mark says."""
    counts = run_counts(study, spec, mask)
    runs = f"{min(counts)}" if min(counts) == max(counts) else f"{min(counts)} to {max(counts)}"
    if max(counts) == 1:
        return "one run per point"
    hollow = "; open mark: some runs gave no estimate" if _some_missing(study, spec, mask) else ""
    return f"median and 10-90 % range of {runs} runs per point{hollow}"


def _some_missing(study: Study, spec: Figure, mask: np.ndarray) -> bool:
    for panel in spec.panels:
        rows = mask & where(study.columns, panel.where) & (study.columns["status"] != "not_applicable")
        if any(not np.isfinite(study.columns[y][rows]).all() for y in panel.y):
            return True
    return False


def run_counts(study: Study, spec: Figure, mask: np.ndarray) -> list[int]:
    """Runs behind each drawn point (rows where the method applies)."""
    keys = (
        [spec.x] + ([spec.series] if spec.series else []) + sorted({k for p in spec.panels for k in p.where})
    )
    applies = mask & (study.columns["status"] != "not_applicable") & has_value(study.columns, spec.x)
    return list(Counter(zip(*(study.columns[k][applies] for k in keys))).values()) or [0]
