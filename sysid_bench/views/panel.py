"""one panel of a figure spec -> curves, bands, bound, theory and marks on matplotlib axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from sysid_bench.views.spec import Figure, Panel
from sysid_bench.views.study import Curve, Study, curve, numbers_of
from sysid_bench.views.style import BOUND_COLOUR, GUIDE_COLOUR, log_ticks, look, wrapped

Mode = Literal["band", "whiskers", "theory", "words"]
BOUND = "Cramér-Rao bound (rms)"
MANY_CURVES = 3  # more than this many bands hide each other: whiskers instead


def series_values(study: Study, spec: Figure, mask: np.ndarray) -> list[Any]:
    """Values of the series column in the study's order, of the rows drawn; [None] where there is no series."""
    if spec.series is None:
        return [None]
    present = set(study.columns[spec.series][mask])
    return [value for value in study.order(spec.series) if value in present]


def label_of(spec: Figure, value: Any) -> str:
    """Words for a series value or a column."""
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return str(spec.names.get(text, text.replace("_", " ")))


def draw_panel(
    axis: Any, study: Study, spec: Figure, panel: Panel, mask: np.ndarray, series: Sequence[Any]
) -> dict[str, Any]:
    """Curves, bound, theory and marks of one panel; returns legend label -> handle."""
    handles: dict[str, Any] = {}
    curves = [(value, i, j) for i, value in enumerate(series) for j in range(len(panel.y))]
    for k, (value, i, j) in enumerate(curves):
        rows = mask if value is None else mask & (study.columns[spec.series or ""] == value)
        data = curve(study.columns, spec.x, panel.y[j], rows)
        if not np.isfinite(data.median).any():
            continue
        style, label = curve_look(spec, panel, value, i, j, len(series))
        x, mode = positions(study, spec, data.x), curve_mode(study, spec, panel, len(curves))
        x = x + (k - (len(curves) - 1) / 2) * 0.7 / len(curves) if mode == "words" else x
        handles[label] = draw_curve(axis, x, data, style, mode)
        if panel.theory:
            handles |= _draw_theory(axis, study, spec, panel, rows, j, style)
    handles |= _draw_bounds(axis, study, spec, panel, mask)
    _scale(axis, spec, panel)
    handles |= _marks(axis, spec, panel)
    return handles


def curve_mode(study: Study, spec: Figure, panel: Panel, curves: int) -> Mode:
    """How a curve is drawn: no line between words, faint lines beside theory, bands while they are few."""
    if study.columns[spec.x].dtype.kind not in "fiu":
        return "words"
    return "theory" if panel.theory else "whiskers" if curves > MANY_CURVES else "band"


def curve_look(
    spec: Figure, panel: Panel, value: Any, i: int, j: int, series: int
) -> tuple[dict[str, Any], str]:
    """Style and legend words of series i, column j: colour tells series apart, or columns where several share axes."""
    column, several, many = panel.y[j], len(panel.y) > 1, series > 1
    style = look(i)
    if several:
        style = look(_shared_columns(spec).index(column)) | (
            {k: style[k] for k in ("marker", "linestyle")} if many else {}
        )
    words = [label_of(spec, value)] if value is not None and (many or not several) else []
    return style, ", ".join(words + ([label_of(spec, column)] if several or not words else []))


def _shared_columns(spec: Figure) -> list[str]:
    return list(dict.fromkeys(y for panel in spec.panels if len(panel.y) > 1 for y in panel.y))


def draw_curve(axis: Any, x: np.ndarray, data: Curve, style: dict[str, Any], mode: Mode) -> Any:
    """Median as line and marks (hollow where runs are missing), quantiles as a band or as whiskers; a legend handle."""
    seen = np.isfinite(data.median)
    x, median, low, high, missing = (v[seen] for v in (x, data.median, data.low, data.high, data.missing))
    if mode != "words":
        faint = {"linewidth": 0.6, "alpha": 0.6} if mode == "theory" else {}
        axis.plot(x, median, **style | {"marker": ""} | faint)
    if mode == "band":
        axis.fill_between(x, low, high, color=style["color"], alpha=0.16, linewidth=0)
    else:
        axis.errorbar(
            x,
            median,
            [median - low, high - median],
            fmt="none",
            ecolor=style["color"],
            elinewidth=0.8,
            alpha=0.6,
        )
    size = 3.6 if mode == "theory" else style["markersize"]
    marks = {
        "linestyle": "",
        "marker": style["marker"],
        "color": style["color"],
        "zorder": 3,
        "markersize": size,
    }
    axis.plot(x[missing == 0], median[missing == 0], **marks)
    axis.plot(x[missing > 0], median[missing > 0], **marks, markerfacecolor="white")
    (handle,) = axis.plot([], [], **style | ({"linestyle": ""} if mode in ("words", "theory") else {}))
    return handle


def positions(study: Study, spec: Figure, x: np.ndarray) -> np.ndarray:
    """Places on the x axis: the numbers themselves, or 0, 1, 2, ... for words in the study's order."""
    if x.dtype.kind in "fiu":
        return x.astype(float)
    rank = {value: k for k, value in enumerate(study.order(spec.x))}
    return np.array([rank[value] for value in x], dtype=float)


def _draw_theory(
    axis: Any, study: Study, spec: Figure, panel: Panel, rows: np.ndarray, j: int, style: dict[str, Any]
) -> dict[str, Any]:
    data = curve(study.columns, spec.x, panel.theory[min(j, len(panel.theory) - 1)], rows)
    alone = len(panel.y) == 1
    x = positions(study, spec, data.x)
    axis.plot(x, data.median, color=BOUND_COLOUR if alone else style["color"], linewidth=1.1, zorder=2)
    (proxy,) = axis.plot([], [], color=BOUND_COLOUR if alone else GUIDE_COLOUR, linewidth=1.1)
    return {label_of(spec, "theory"): proxy}


def _draw_bounds(axis: Any, study: Study, spec: Figure, panel: Panel, mask: np.ndarray) -> dict[str, Any]:
    handles = {}
    look_of_bound = {
        "color": BOUND_COLOUR,
        "alpha": 0.75,
        "zorder": 1.5,
        "linestyle": (0, (1, 0.6)),
        "linewidth": 2.2,
    }
    for name in panel.bound:
        data = bound_curve(study, spec, name, mask)
        x = positions(study, spec, data.x)
        if data.x.dtype.kind in "fiu":
            (handles[label_of(spec, BOUND)],) = axis.plot(x, data.median, **look_of_bound)
        else:
            handles[label_of(spec, BOUND)] = axis.hlines(data.median, x - 0.42, x + 0.42, **look_of_bound)
    return handles


def bound_curve(study: Study, spec: Figure, name: str, mask: np.ndarray) -> Curve:
    """Median over the records of their bound; a record is counted however the methods fared on it."""
    columns = {**study.columns, "status": np.full(study.rows, "ok", dtype=object)}
    return curve(columns, spec.x, name, mask & np.isfinite(numbers_of(study.columns, name)))


def _scale(axis: Any, spec: Figure, panel: Panel) -> None:
    axis.set_title(panel.title, loc="left", pad=14 if spec.vlines or panel.vlines else 6)
    axis.set_ylabel(wrapped(panel.label or label_of(spec, panel.y[0])))
    if spec.x_log:
        axis.set_xscale("log")
        log_ticks(axis.xaxis, *axis.get_xlim())
    if spec.y_log if panel.y_log is None else panel.y_log:
        axis.set_yscale("log", nonpositive="mask")
        log_ticks(axis.yaxis, *axis.get_ylim())
    elif panel.y_limits is None:
        _robust_limits(axis, [float(line["y"]) for line in panel.hlines])
    if panel.y_limits is not None:
        axis.set_ylim(*panel.y_limits)


def _robust_limits(axis: Any, marks: Sequence[float]) -> None:
    """Linear axes follow the lines, not the bands: one wild quantile must not flatten every curve."""
    heights = np.concatenate([np.asarray(line.get_ydata(), float) for line in axis.lines] + [np.array(marks)])
    heights = heights[np.isfinite(heights)]
    if len(heights) and np.ptp(heights) > 0:
        axis.set_ylim(heights.min() - 0.15 * np.ptp(heights), heights.max() + 0.15 * np.ptp(heights))


def _marks(axis: Any, spec: Figure, panel: Panel) -> dict[str, Any]:
    lines = sorted([*spec.vlines, *panel.vlines], key=lambda v: float(v["x"]))
    for i, line in enumerate(lines):
        axis.axvline(float(line["x"]), color=GUIDE_COLOUR, linewidth=0.9, linestyle=(0, (4, 2)), zorder=1)
        side = "center" if len(lines) == 1 else "right" if i < len(lines) / 2 else "left"
        axis.text(float(line["x"]), 1.01, f" {line.get('label', '')} ", transform=axis.get_xaxis_transform(),
                  ha=side, va="bottom", fontsize=7.5, color="#444444")  # fmt: skip
    handles = {}
    for line in panel.hlines:
        handles[str(line.get("label", ""))] = axis.axhline(
            float(line["y"]), color=GUIDE_COLOUR, linewidth=1.0, linestyle=(0, (2, 2)), zorder=1
        )
    return {label: handle for label, handle in handles.items() if label}
