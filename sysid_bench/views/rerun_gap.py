"""answer of the gap workflow -> gap.rrd: measured, given and better model over time, residuals, spectra, the words."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench.gap.workflow import Answer
from sysid_bench.views.gap_report import WORDS, place_words, unexplained
from sysid_bench.views.rerun_record import log_markdown, log_series, panels, recording, signal_view, x_range

IN_SIGHT = 600


def write_gap_rrd(path: Path, answer: Answer, values: Mapping[str, Any]) -> Path:
    """Write the recording with its blueprint."""
    import rerun as rr
    import rerun.blueprint as rrb

    after = answer.after[0]
    t = after.trace.t
    axis = x_range(float(t[0]), float(t[min(len(t), IN_SIGHT) - 1]), "seconds")
    views = [
        signal_view(f"output/{c + 1}", f"y{c + 1}: measured, given and better model", axis)
        for c in range(after.trace.y.shape[1])
    ]
    force = [e for e in answer.story.fit.point.effects if e.path == "force"]
    if force:
        views.append(signal_view("force", "unexplained force and the effect", axis))
    plots = rrb.Grid(*views, grid_columns=1 if len(views) <= 4 else 2)
    words = rrb.TextDocumentView(origin="about", name="verdict")
    blueprint = rrb.Blueprint(rrb.Horizontal(plots, words, column_shares=[3, 1]), *panels("t"))
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
        log_markdown(stream, "about", words_of(values))
    return path


def _log_force(stream: Any, answer: Answer, effect: Any) -> None:
    import rerun as rr

    from sysid_bench.gap.motion import force_along
    from sysid_bench.mechanics.effect import direction

    trace = answer.problem.traces[0]
    x, v, force = unexplained(answer, direction(effect.dof, answer.problem.model.n))
    index = rr.TimeColumn("t", duration=trace.t)
    log_series(stream, "force/unexplained", index, force, "unexplained force", -1)
    log_series(stream, "force/effect", index, force_along(effect, x, v, trace.h, trace.t0), effect.name, 1)


def words_of(values: Mapping[str, Any]) -> str:
    """The verdict as markdown."""
    lines = [f"# {WORDS[values['verdict']]}", "", values["reason"], ""]
    for effect in values["effects"]:
        lines.append(f"- **{effect['name']}** at {place_words(effect['dof'])}: `{effect['equation']}`")
        for key, p in effect["parameters"].items():
            value = p["value"] if isinstance(p["value"], str) else f"{p['value']:.4g}"
            lines.append(
                f"    - {key} {value} {p['unit']}" + (f" ± {2 * p['std']:.2g}" if "std" in p else "")
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
    return "\n".join(lines)
