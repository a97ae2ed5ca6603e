"""answer of the gap workflow -> report.html: one page that a person reads before believing a name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sysid_bench.gap.answer import Answer
from sysid_bench.views.gap_figures import images
from sysid_bench.views.gap_words import WORDS, equations, place_words, suspects
from sysid_bench.views.html import flat, render, write_page


def write_gap_report(out: Path, answer: Answer, values: Mapping[str, Any]) -> Path:
    """Write report.html into `out`."""
    page = render(
        "gap.html", title=WORDS[values["verdict"]], values=values, images=images(answer, values),
        equations=equations(answer), moved=values["parameters_moved"], number=lambda x: "" if x is None else f"{x:.4g}",
        place=place_words, suspects=suspects(values), power=sorted(values["power"].items()), origin=flat(values["origin"]),
    )  # fmt: skip
    return write_page(out / "report.html", page)
