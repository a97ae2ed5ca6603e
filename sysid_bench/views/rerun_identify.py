"""record, prediction -> identify.rrd: measured and simulated output over time, the residual, the input, the numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sysid_bench.nouns import Array, Estimate, Record
from sysid_bench.views.identify_figures import MATRICES
from sysid_bench.views.rerun_record import (
    log_markdown,
    log_series,
    log_signals,
    panels,
    recording,
    seconds_in_sight,
    signal_view,
)

LARGEST_PAGE = 6


def write_identify_rrd(
    path: Path, record: Record, estimate: Estimate, predicted: Array | None, title: str
) -> Path:
    """Write the recording with its blueprint; without a prediction it shows the record and the numbers."""
    import rerun as rr
    import rerun.blueprint as rrb

    axis = seconds_in_sight(record.t, record.y)
    views = [
        signal_view(f"output/{j + 1}", f"y{j + 1}: measured and simulated", axis) for j in range(record.ny)
    ]
    inputs = signal_view("u", "input", axis)
    page = rrb.TextDocumentView(origin="about", name="estimate")
    plots = rrb.Vertical(rrb.Grid(*views, grid_columns=1 if record.ny <= 4 else 2), inputs, row_shares=[4, 1])
    blueprint = rrb.Blueprint(rrb.Horizontal(plots, page, column_shares=[3, 1]), *panels("t"))
    with recording("sysid_bench_identify", path, blueprint) as stream:
        log_signals(stream, record)
        index = rr.TimeColumn("t", duration=record.t)
        for j in range(record.ny):
            _log_output(
                stream,
                index,
                record.y[:, j],
                None if predicted is None else predicted[:, j],
                f"output/{j + 1}",
            )
        log_markdown(stream, "about", numbers(estimate, title))
    return path


def _log_output(stream: Any, index: Any, y: Array, predicted: Array | None, entity: str) -> None:
    log_series(stream, f"{entity}/measured", index, y, "measured", -1)
    if predicted is not None:
        log_series(stream, f"{entity}/simulated", index, predicted, "simulated", 1)
        log_series(stream, f"{entity}/residual", index, y - predicted, "residual", 0, 1.0)


def numbers(estimate: Estimate, title: str) -> str:
    """Status and matrices as markdown; larger matrices are left to the report."""
    lines = [f"# {title}", "", f"{estimate.status} {estimate.reason}", ""]
    for X in MATRICES:
        value, std = getattr(estimate, X), estimate.std(X)
        if value is not None and len(value) <= LARGEST_PAGE:
            lines += [f"## {X}", "", "|" + " |" * len(value), "|" + "-|" * len(value)]
            lines += [_row(value[i], None if std is None else 1.96 * std[i]) for i in range(len(value))]
    return "\n".join(lines)


def _row(values: Array, half: Array | None) -> str:
    cells = [
        f"{v:.4g}" + ("" if half is None else f" ± {h:.2g}")
        for v, h in zip(values, values if half is None else half)
    ]
    return "| " + " | ".join(cells) + " |"
