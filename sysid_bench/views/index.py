"""results folder -> index.html: a card per study with its question, first figure and report."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from sysid_bench.nouns import InputError
from sysid_bench.views.html import render, write_page
from sysid_bench.views.spec import study_figures
from sysid_bench.views.study import Study, failed, read_study


def write_index_page(results_dir: Path) -> Path:
    """Write index.html of a results folder, its studies grouped by the folder of their experiment."""
    studies = sorted(_studies(results_dir), key=lambda study: _numbers_sorted(experiment(study)))
    groups: dict[str, list[Mapping[str, str]]] = {}
    for study in studies:
        groups.setdefault(experiment(study).rpartition("/")[0], []).append(_card(study, results_dir))
    page = render(
        "index.html", groups=groups, count=len(studies), rows=sum(s.rows for s in studies),
        papers=(results_dir / "papers.html").is_file(),
    )  # fmt: skip
    return write_page(results_dir / "index.html", page)


def _studies(results_dir: Path) -> list[Study]:
    found = []
    for manifest in results_dir.glob("**/manifest.json"):
        try:
            found.append(read_study(manifest.parent))
        except (InputError, ValueError, OSError):
            continue  # not a finished study
    return found


def experiment(study: Study) -> str:
    """`folder/name` of the experiment as its command says it; else the study's name."""
    words = str(study.manifest.get("command", "")).split()
    return next((w.partition("=")[2] for w in words if w.startswith("experiment=")), study.name)


def _numbers_sorted(text: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", text)]


def _card(study: Study, results_dir: Path) -> Mapping[str, str]:
    place = study.folder.relative_to(results_dir).as_posix()
    pictures = [study.folder / "figures" / f"{spec.name}.png" for spec in study_figures(study)]
    thumbnail = next((f"{place}/figures/{p.name}" for p in pictures if p.is_file()), "")
    return {
        "name": study.name, "question": str(study.manifest.get("question", "")), "link": f"{place}/report.html",
        "thumbnail": thumbnail, "line": f"{study.rows} runs, {int(failed(study.columns).sum())} failed",
    }  # fmt: skip
