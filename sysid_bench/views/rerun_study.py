"""study -> study.rrd: its curves with quantiles and bound, tables, figures, and the signals of one record.

The viewer has no logarithmic axes: where a figure has them, log10 is plotted, and the view's name says so. All its
plots share one timeline, `x`: 1000 log10(1e6 x) or 1000 x for curves (a sampling time of 1 ms is at 3000, 10 ms at
4000), the sample number for signals. It must not be negative: the viewer shows no images there.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench.views.panel import bound_curve, curve_look, label_of, positions, series_values
from sysid_bench.views.report import summary_markdown
from sysid_bench.views.rerun_record import (
    facts,
    groups,
    log_markdown,
    log_series,
    log_signals,
    panels,
    recording,
    samples_in_sight,
    signal_view,
    x_range,
)
from sysid_bench.views.spec import Figure, Panel, study_figures
from sysid_bench.views.study import Study, curve, where

SAMPLES_SHOWN = 20000


def write_study_rrd(study: Study, figures: Sequence[Path]) -> Path:
    """Write study.rrd with its blueprint beside the report; returns its path."""
    import rerun as rr
    import rerun.blueprint as rrb

    path, specs = study.folder / "study.rrd", study_figures(study)
    pictures = [p for p in figures if p.suffix == ".png"]
    kept = _first_record(study)
    tabs = [_curves_tab(study, spec) for spec in specs]
    tabs += [rrb.TextDocumentView(origin="numbers", name="numbers")]
    tabs += [_record_tab(*kept)] if kept else []
    with recording(
        "sysid_bench_study", path, rrb.Blueprint(rrb.Tabs(*tabs, active_tab=0), *panels("x"))
    ) as stream:
        stream.send_columns(
            "start", [rr.TimeColumn("x", sequence=[0])], rr.Scalars.columns(scalars=[0.0])
        )  # ticks
        for spec in specs:
            _log_figure(stream, study, spec)
        for picture in pictures:
            stream.log(f"figure/{picture.stem}", rr.EncodedImage(path=picture), static=True)
        log_markdown(stream, "numbers", summary_markdown(study))
        if kept:
            _log_record(stream, *kept)
    return path


def _first_record(study: Study) -> tuple[Path, Any] | None:
    from sysid_bench.records import read_record

    found = sorted((study.folder / "records").glob("*.mcap"))
    return (found[0], read_record(found[0])) if found else None


def _curves_tab(study: Study, spec: Figure) -> Any:
    """The curves of one figure as plots, beside the printed figure."""
    import rerun.blueprint as rrb

    places = _places(study, spec, np.array(study.order(spec.x)))
    margin = max(1, int(0.03 * np.ptp(places)))
    axis = x_range(places.min() - margin, places.max() + margin)
    own = any(len(panel.y) > 1 for panel in spec.panels)  # else one legend speaks for all, and hides less
    views = [
        signal_view(f"{spec.name}/{k}", _panel_name(spec, panel), axis, legend=own or k == 0)
        for k, panel in enumerate(spec.panels)
    ]
    picture = rrb.Spatial2DView(origin=f"figure/{spec.name}", name=f"figures/{spec.name}.png")
    return rrb.Horizontal(
        rrb.Grid(*views, grid_columns=-(-len(views) // 2) if len(views) < 5 else 3),
        picture,
        column_shares=[3, 2],
        name=spec.title or spec.name,
    )


def _panel_name(spec: Figure, panel: Panel) -> str:
    what = " ".join(filter(None, [panel.title, panel.label or ", ".join(panel.y)]))
    x = f"1000 log10(1e6 {spec.x})" if spec.x_log else f"1000 {spec.x}"
    return f"{'log10 of ' if _is_log(spec, panel) else ''}{what}, against {x}"


def _is_log(spec: Figure, panel: Panel) -> bool:
    return spec.y_log if panel.y_log is None else panel.y_log


def _places(study: Study, spec: Figure, values: np.ndarray) -> np.ndarray:
    x = positions(study, spec, values)
    return np.round(1000 * (np.log10(1e6 * x) if spec.x_log else x)).astype(np.int64)


def _log_figure(stream: Any, study: Study, spec: Figure) -> None:
    mask = where(study.columns, spec.where)
    series = series_values(study, spec, mask)
    for k, panel in enumerate(spec.panels):
        rows = mask & where(study.columns, panel.where)
        entity = f"{spec.name}/{k}"
        for i, value in enumerate(series):
            chosen = rows if value is None else rows & (study.columns[spec.series or ""] == value)
            for j, column in enumerate(panel.y):
                label = curve_look(spec, panel, value, i, j, len(series))[1]
                data = curve(study.columns, spec.x, column, chosen)
                colour = j if len(panel.y) > 1 and len(series) == 1 else i
                _log_curve(stream, study, spec, panel, f"{entity}/{i}_{j}", data, label, colour)
        for name in (*panel.bound, *panel.theory):
            data = bound_curve(study, spec, name, rows)
            words = "Cramér-Rao bound" if name in panel.bound else label_of(spec, "theory")
            _log_line(
                stream, study, spec, panel, f"{entity}/{name}", data.x, data.median, words, -1, 2.0, 255
            )


def _log_curve(
    stream: Any, study: Study, spec: Figure, panel: Panel, entity: str, data: Any, label: str, colour: int
) -> None:
    """Median thick, quantiles thin; all three have one name, which gives them one entry in the legend."""
    _log_line(stream, study, spec, panel, f"{entity}/median", data.x, data.median, label, colour, 2.5, 255)
    if (data.runs > 1).any():
        for word, values in (("low", data.low), ("high", data.high)):
            _log_line(stream, study, spec, panel, f"{entity}/{word}", data.x, values, label, colour, 1.0, 255)


def _log_line(
    stream: Any, study: Study, spec: Figure, panel: Panel, entity: str, x: np.ndarray, y: np.ndarray, name: str, colour: int,
    width: float, shade: int,
) -> None:  # fmt: skip
    import rerun as rr

    seen = np.isfinite(y) & ((y > 0) | (not _is_log(spec, panel)))
    if seen.any():
        index = rr.TimeColumn("x", sequence=_places(study, spec, x[seen]))
        heights = np.log10(y[seen]) if _is_log(spec, panel) else y[seen]
        log_series(stream, entity, index, heights, name, colour, width, shade)


def _record_tab(path: Path, record: Any) -> Any:
    import rerun.blueprint as rrb

    axis = x_range(0, samples_in_sight(record.y))
    plots = [signal_view(f"record/{g}", f"{g} against the sample number", axis) for g in groups(record)]
    page = rrb.TextDocumentView(origin="record/about", name="about")
    return rrb.Horizontal(rrb.Vertical(*plots), page, column_shares=[4, 1], name=f"record {path.stem[:12]}")


def _log_record(stream: Any, path: Path, record: Any) -> None:
    import rerun as rr

    last = min(record.N, SAMPLES_SHOWN)
    log_signals(stream, record, "record/", rr.TimeColumn("x", sequence=np.arange(last)), last)
    log_markdown(stream, "record/about", facts(record, path.name))
