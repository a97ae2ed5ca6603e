"""study -> report.html: question, command, figures, numbers, failures, configuration, origin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench.views.html import flat, image, render, write_page
from sysid_bench.views.spec import left_out, study_figures
from sysid_bench.views.study import Study, failed
from sysid_bench.views.summary import ERRORS, Group, Number, failures, measured_columns, plain, summarise


def write_report(study: Study, figures: Sequence[Path]) -> Path:
    """Write report.html of a study with the figures inlined; returns its path."""
    columns = measured_columns(study)
    page = render(
        "study.html", name=study.name, question=study.manifest.get("question", ""), facts=facts(study),
        command=command(study), images=[_image(study, p) for p in figures if p.suffix == ".svg"],
        axes=study.axes, columns=[_heading(c) for c in columns], bounds=any(c.replace("_error", "_bound") in study.columns for c in columns if c in ERRORS),
        groups=[_group_words(g, columns) for g in summarise(study)],
        left_out=left_out(study),
        failures=[(*f[:4], f"{f[4]:.0%}", f[5]) for f in failures(study)], config=config_text(study),
        origin=flat(study.manifest.get("origin") or {}),
    )  # fmt: skip
    return write_page(study.folder / "report.html", page)


def command(study: Study) -> str:
    """The command line that makes the study again."""
    return str(study.manifest.get("command") or f"sysid-bench sweep experiment={study.name}")


def config_text(study: Study) -> str:
    """Resolved configuration as yaml."""
    import yaml

    tree = {"config": dict(study.config), "options": study.manifest.get("options") or {}}
    return yaml.safe_dump(tree, sort_keys=False, allow_unicode=True, width=110)


def facts(study: Study) -> list[tuple[str, str]]:
    """The few numbers at the head of the page: rows, repetitions, failures, time in fits."""
    seconds = study.columns.get("fit_s", study.columns.get("seconds", np.zeros(0)))
    rows = [(f"{study.rows}", "runs")]
    for column, word in (("method", "methods"), ("repetition", "repetitions per cell")):
        values = set(study.columns.get(column, ()))
        rows += [(f"{len(values)}", word)] if values else []
    lost = int(failed(study.columns).sum())
    rows += [
        (f"{lost}", "failed"),
        (f"{(study.columns['status'] == 'not_applicable').sum()}", "not applicable"),
    ]
    return [*rows, (_duration(float(np.nansum(seconds))), "computing")]


def _duration(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds < 120 else f"{seconds / 60:.1f} min"


def _image(study: Study, path: Path) -> Mapping[str, str]:
    spec = next((f for f in study_figures(study) if f.name == path.stem), None)
    caption = spec.caption if spec else ""
    return image(path, caption or (spec.title if spec else path.stem), caption)


def _heading(column: str) -> str:
    return f"{column.removesuffix('_error')} error (%)" if column in ERRORS else column


def _group_words(group: Group, columns: Sequence[str]) -> Mapping[str, Any]:
    words = f"{group.failures}" + (f" + {group.not_applicable} n/a" if group.not_applicable else "")
    numbers = [_number_words(n, 100.0 if c in ERRORS else 1.0) for n, c in zip(group.numbers, columns)]
    return {
        "cells": [plain(v) for v in group.values], "runs": group.runs, "failures": group.failures,
        "failed_words": words, "numbers": numbers, "seconds": _digits(group.seconds),
    }  # fmt: skip


def summary_markdown(study: Study) -> str:
    """The summary table and the failures as markdown, for viewers that render it."""
    columns = measured_columns(study)
    head = [*study.axes, "runs", "failed", *(_heading(c) for c in columns), "seconds"]
    lines = [f"# {study.name}", "", str(study.manifest.get("question", "")), "", f"`{command(study)}`", ""]
    lines += ["Medians; × is the rms ratio to the Cramér-Rao bound.", "", _row(head), _row(["-"] * len(head))]
    for group in (_group_words(g, columns) for g in summarise(study)):
        numbers = [f"{n['median']} {n['over_bound']}" for n in group["numbers"]]
        lines.append(
            _row([*group["cells"], group["runs"], group["failed_words"], *numbers, group["seconds"]])
        )
    lines += [
        "",
        "## Runs without an estimate",
        "",
        _row(["method", "status", "reason", "runs"]),
        _row(["-"] * 4),
    ]
    return "\n".join([*lines, *(_row(f[:4]) for f in failures(study))])


def _row(cells: Sequence[Any]) -> str:
    return "| " + " | ".join(str(cell).replace("|", "/").replace("_", "\\_") for cell in cells) + " |"


def _number_words(number: Number, scale: float) -> Mapping[str, str]:
    words = {key: _digits(scale * getattr(number, key)) for key in ("low", "median", "high", "rms")}
    return words | {"over_bound": f"×{_digits(number.over_bound)}" if isfinite(number.over_bound) else ""}


def _digits(value: float) -> str:
    if not isfinite(value):
        return "-"
    if value == 0 or 1e-3 <= abs(value) < 1e5:
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    return f"{value:.1e}"
