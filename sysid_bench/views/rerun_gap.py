"""answer of the gap workflow -> gap.rrd: measured, given and better model over time, residuals, spectra, the words."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench.gap.answer import Answer
from sysid_bench.gap.inverse import ENDS
from sysid_bench.views.gap_clouds import found_forces, unexplained
from sysid_bench.views.gap_figures import leftover, power_by_frequency
from sysid_bench.views.gap_words import WORDS, budget, place_words, suspects, unit_of
from sysid_bench.views.rerun_record import (
    log_markdown,
    log_series,
    panels,
    recording,
    seconds_in_sight,
    signal_view,
)

CLOUD, BANDS = 3000, 60


def write_gap_rrd(path: Path, answer: Answer, values: Mapping[str, Any]) -> Path:
    """Write the recording with its blueprint."""
    import rerun as rr
    import rerun.blueprint as rrb

    after = answer.after[0]
    t = after.trace.t
    axis = seconds_in_sight(t, after.trace.y, int(ENDS * len(t)))  # where the force is shown
    views = [
        signal_view(
            f"output/{c + 1}", f"y{c + 1} ({unit_of(answer, c)}): measured, given and better model", axis
        )
        for c in range(after.trace.y.shape[1])
    ]
    force = found_forces(answer)
    if force:
        views.append(signal_view("force", "unexplained force and the effect (N)", axis))
    plots = rrb.Grid(*views, grid_columns=1 if len(views) <= 4 else 2)
    side: list[rrb.View] = [rrb.TextDocumentView(origin="about", name="verdict")]
    side += [rrb.BarChartView(origin="spectrum", name="residual by frequency, dB over the floor, Hz")]
    if force:
        side.append(
            rrb.Spatial3DView(origin="cloud", name="force over displacement and velocity, each over its rms")
        )
    right = rrb.Vertical(*side, row_shares=[3, 2, 3][: len(side)])
    blueprint = rrb.Blueprint(rrb.Horizontal(plots, right, column_shares=[5, 3]), *panels("t"))
    with recording("sysid_bench_gap", path, blueprint) as stream:
        index = rr.TimeColumn("t", duration=t)
        for c in range(after.trace.y.shape[1]):
            y, before = after.trace.y[:, c], answer.before[0].predicted[:, c]
            log_series(stream, f"output/{c + 1}/measured", index, y, "measured", -1)
            log_series(stream, f"output/{c + 1}/given", index, before, "given model", 1)
            log_series(stream, f"output/{c + 1}/better", index, after.predicted[:, c], "better model", 0)
            log_series(
                stream, f"output/{c + 1}/residual", index, y - after.predicted[:, c], "residual", 2, 1.0
            )
        if force:
            _log_force(stream, answer, force[0])
        _log_spectrum(stream, answer)
        log_markdown(stream, "about", words_of(values))
    return path


def _log_force(stream: Any, answer: Answer, effect: Any) -> None:
    import rerun as rr

    from sysid_bench.gap.motion import force_along

    trace = answer.problem.traces[0]
    x, v, force = unexplained(answer, effect)
    fitted = force_along(effect, x, v, trace.h, trace.t0)
    ends = int(ENDS * trace.N)  # there a motion is not differentiated well
    x, v, force, fitted, t = (z[ends : trace.N - ends] for z in (x, v, force, fitted, trace.t))
    index = rr.TimeColumn("t", duration=t)
    log_series(stream, "force/unexplained", index, force, "unexplained force", -1)
    log_series(stream, "force/effect", index, fitted, effect.name, 1)
    step = max(1, len(x) // CLOUD)
    for name, values, colour in (("unexplained", force, (200, 200, 200)), ("effect", fitted, (230, 120, 30))):
        size = max(float(np.sqrt(np.mean(fitted**2))), 1e-300)
        points = np.column_stack([x / max(x.std(), 1e-300), v / max(v.std(), 1e-300), values / size])[::step]
        stream.log(f"cloud/{name}", rr.Points3D(points, colors=[colour], radii=[0.02]), static=True)


def _log_spectrum(stream: Any, answer: Answer) -> None:
    """Mean residual power per band of the given and the better model over the noise floor, dB."""
    import rerun as rr

    looks = (("given", (213, 94, 0)), ("better", (0, 114, 178)))
    for (name, colour), (t, r) in zip(looks, leftover(answer)):
        f, power = power_by_frequency(answer, t, r)
        bands = np.array_split(np.arange(len(f)), min(BANDS, len(f)))
        levels = [10 * np.log10(max(float(power[b].mean()), 0.1)) for b in bands]
        centres = [float(f[b].mean()) for b in bands]
        widths = np.full(len(levels), 0.9 * (centres[-1] - centres[0]) / max(len(levels) - 1, 1))
        chart = rr.BarChart(np.array(levels), abscissa=np.array(centres), widths=widths, color=colour)
        stream.log(f"spectrum/{name}", chart, static=True)


def words_of(values: Mapping[str, Any]) -> str:
    """The verdict as markdown."""
    lines = [f"# {WORDS[values['verdict']]}", "", values["reason"], ""]
    for effect in values["effects"]:
        lines.append(f"- **{effect['name']}** at {place_words(effect['dof'])}: `{effect['equation']}`")
        for key, p in effect["parameters"].items():
            value = p["value"] if isinstance(p["value"], str) else f"{p['value']:.4g}"
            lines.append(
                f"    - {key} {value} {p['unit']}"
                + (f" ± {2 * p['std']:.2g}" if p["std"] is not None else "")
            )
    shares = [
        ("as given", values["gap_before"]),
        ("better", values["gap_after"]),
        ("noise floor", values["noise_floor"]),
    ]
    lines += [
        "",
        "| held-out error | |",
        "|-|-|",
        *(f"| {name} | {100 * float(np.real(v)):.3g} % |" for name, v in shares),
    ]
    lines += ["", "| left over the floor (rms), training | |", "|-|-|"]
    lines += [f"| {name} | {value:.3g} |" for name, value in budget(values)]
    ranked = suspects(values)[:8]
    if ranked:
        lines += ["", "| look | suspect | explains | left, over the floor (rms) |", "|-|-|-|-|"]
        lines += ["| " + " | ".join(row) + " |" for row in ranked]
    power = sorted(values["power"].items())
    if power:
        lines += ["", "| would have been seen from | | |", "|-|-|-|"]
        lines += [
            f"| {name} | {p['parameter']} {p['smallest']:.3g} {p['unit']} | {place_words(p['dof'])} |"
            for name, p in power
        ]
    return "\n".join(lines)
