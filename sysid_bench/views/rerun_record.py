"""record -> rerun recording: every input and output over time, flagged samples, and what made it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.fft import rfft

from sysid_bench.nouns import CLIPPED, CORRUPTED, DUPLICATED, LATE, LOST, REORDERED, STUCK, Array, Record
from sysid_bench.views.html import flat
from sysid_bench.views.style import COLOURS

FLAGS = {LOST: "lost", DUPLICATED: "duplicated", REORDERED: "reordered", CORRUPTED: "corrupted", LATE: "late",
         CLIPPED: "clipped", STUCK: "stuck"}  # fmt: skip

SWINGS, FEWEST, MOST = (
    20,
    300,
    100_000,
)  # in sight of the slowest channel; samples; the rest is there to scroll to


def write_record_rrd(record: Record, path: Path, title: str) -> Path:
    """Write a recording with its blueprint: outputs over inputs on the timeline `t`, and a page of facts."""
    import rerun.blueprint as rrb

    page = rrb.TextDocumentView(origin="about", name="about")
    axis = seconds_in_sight(record.t, record.y)
    plots = [signal_view(group, group, axis) for group in groups(record)]
    shares = [3, 2, 1][: len(plots)]
    blueprint = rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(*plots, row_shares=shares), page, column_shares=[4, 1]),
        *panels("t"),
    )
    with recording("sysid_bench_record", path, blueprint) as stream:
        log_signals(stream, record)
        log_markdown(stream, "about", facts(record, title))
    return path


def groups(record: Record) -> list[str]:
    """Entities that a record fills: y, u, and quality where samples are flagged."""
    return ["y", "u", *([] if record.all_good else ["quality"])]


def signal_view(origin: str, name: str, axis: Any, legend: bool = True) -> Any:
    """A plot of everything under `origin`."""
    import rerun.blueprint as rrb

    return rrb.TimeSeriesView(
        origin=origin, name=name, axis_x=axis, plot_legend=rrb.PlotLegend(visible=legend)
    )


def samples_in_sight(y: Array) -> int:
    """How many samples of y (N, ny) show SWINGS swings of the slowest channel, taken at its median frequency."""
    part = np.nan_to_num(y[:MOST])
    power = np.cumsum(np.abs(rfft(part - part.mean(axis=0), axis=0)) ** 2, axis=0)
    cycles = min((int(np.searchsorted(one, one[-1] / 2)) for one in power.T if one[-1] > 0), default=1)
    return min(max(FEWEST, SWINGS * len(part) // max(cycles, 1)), len(part))


def seconds_in_sight(t: Array, y: Array, first: int = 0) -> Any:
    """The x axis of the samples in sight of y (N, ny) from the first one on."""
    return x_range(float(t[first]), float(t[min(first + samples_in_sight(y), len(t)) - 1]), "seconds")


def x_range(start: float, end: float, kind: str = "seq") -> Any:
    """An x axis that opens on [start, end]: sample numbers, or seconds (kind "seconds")."""
    import rerun as rr
    import rerun.blueprint as rrb

    start, end = (int(start), int(end)) if kind == "seq" else (start, end)
    ends = [rr.TimeRangeBoundary.absolute(**{kind: value}) for value in (start, end)]
    return rrb.TimeAxis(link="Independent", view_range=rr.TimeRange(start=ends[0], end=ends[1]))


def panels(timeline: str) -> list[Any]:
    """Side panels folded away, the time panel on `timeline`, standing still."""
    import rerun.blueprint as rrb

    return [
        rrb.TimePanel(timeline=timeline, state="collapsed", play_state="paused"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    ]


class recording:
    """A rerun stream into a file with a blueprint; the file is whole when the block ends.

    The recording is named by the file, so that the same content gives the same name.
    """

    def __init__(self, application: str, path: Path, blueprint: Any) -> None:
        import rerun as rr

        self.path, self.part = path, path.with_name(path.name + ".part")
        self.stream = rr.RecordingStream(application, recording_id=path.stem)
        self.stream.save(self.part, default_blueprint=blueprint)

    def __enter__(self) -> Any:
        return self.stream

    def __exit__(self, kind: Any, *_: object) -> None:
        self.stream.flush()
        self.stream.disconnect()
        if kind is None:
            self.part.replace(self.path)
        else:
            self.part.unlink(missing_ok=True)


def log_signals(
    stream: Any, record: Record, prefix: str = "", index: Any = None, samples: int | None = None
) -> None:
    """u and y as one series each (unit in its name), quality where samples are flagged.

    index  rerun TimeColumn; None: the timeline `t` in seconds from the record's times.
    """
    import rerun as rr

    end = record.N if samples is None else samples
    index = index if index is not None else rr.TimeColumn("t", duration=record.t[:end])
    for group, values in (("y", record.y), ("u", record.u)):
        units = list(record.units.get(group) or [""] * values.shape[1])
        for j in range(values.shape[1]):
            name = f"{group}{j + 1}" + (f" ({units[j]})" if units[j] else "")
            log_series(stream, f"{prefix}{group}/{j + 1}", index, values[:end, j], name, j)
    if not record.all_good:
        for j, (bit, word) in enumerate(FLAGS.items()):
            flagged = (np.asarray(record.quality)[:end] & bit > 0).astype(float)
            if flagged.any():
                log_series(stream, f"{prefix}quality/{word}", index, flagged, word, j)


def log_series(stream: Any, entity: str, index: Any, values: np.ndarray, name: str, colour: int, width: float = 1.5,
               shade: int = 255) -> None:  # fmt: skip
    """One line: values (nx,) against the index, with a name and the colour of the figures."""
    import rerun as rr

    rgb = _rgb(COLOURS[colour % len(COLOURS)]) if colour >= 0 else (225, 225, 225)
    lines = rr.SeriesLines(colors=[[*rgb, shade]], widths=[width], names=[name])
    stream.log(entity, lines, static=True)
    stream.send_columns(
        entity, indexes=[index], columns=rr.Scalars.columns(scalars=np.asarray(values, float))
    )


def _rgb(colour: str) -> tuple[int, ...]:
    return tuple(int(colour[k : k + 2], 16) for k in (1, 3, 5))


def log_markdown(stream: Any, entity: str, text: str) -> None:
    """A page of text, tables included."""
    import rerun as rr

    stream.log(entity, rr.TextDocument(text, media_type="text/markdown"), static=True)


def facts(record: Record, title: str) -> str:
    """What a record is, as markdown: size, step, hold, flags, levels per channel, origin."""
    step = f"{record.h:g} s" if record.is_uniform else "uneven"
    flagged = 0 if record.quality is None else int(np.count_nonzero(record.quality))
    lines = [f"# {title}", "", "| record | |", "|-|-|", f"| samples | {record.N} |", f"| step | {step} |",
             f"| length | {record.t[-1] - record.t[0]:g} s |", f"| input between samples | {record.hold or 'unknown'} |",
             f"| flagged samples | {flagged} |", "", "| channel | rms | smallest | largest |", "|-|-|-|-|"]  # fmt: skip
    for group, values in (("y", record.y), ("u", record.u)):
        for j, x in enumerate(np.where(np.isfinite(values), values, 0.0).T):
            lines.append(f"| {group}{j + 1} | {np.sqrt(np.mean(x**2)):.4g} | {x.min():.4g} | {x.max():.4g} |")
    origin = flat(dict(record.origin))
    return "\n".join([*lines, "", "## Origin", "", *[f"- `{key}`: {value[:200]}" for key, value in origin]])
