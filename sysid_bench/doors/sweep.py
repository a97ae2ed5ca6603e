"""a sweep's config -> results/<study>/: rows, table, summary, figures, report."""

from __future__ import annotations

import json
import shlex
import shutil
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid_bench import plan
from sysid_bench.build import build
from sysid_bench.files.disk import locked
from sysid_bench.nouns import STATUSES, Executor, InputError, Task
from sysid_bench.progress import watched
from sysid_bench.run import CANNOT_KEEP, Work, check_task
from sysid_bench.store import Store
from sysid_bench.studies import command_line_knobs, study_of
from sysid_bench.table import read_table, summary, summary_columns, write_csv, write_table
from sysid_bench.versions import origin

FLUSH_S = 0.5
FLUSH_ROWS = 200


def main(cfg: dict[str, Any]) -> int:
    """Run what is not yet done of a study, then write its table and views. 0 also where cells failed: a
    failure is a row."""
    return run(study_of(cfg, command_line_knobs(cfg.get("words", []))), cfg)


def run(study: plan.Study, cfg: dict[str, Any]) -> int:
    """As main, where the study of the config is composed already."""
    executor = build(cfg["executor"], study.packages)
    retry = _statuses(cfg["retry"])
    folder = study_folder(Path(cfg["results_dir"]), study.name)
    work = Work(cfg["records"], str(folder / "records"))
    check_figures(cfg)
    order = checked_order(study, cfg.get("only"))
    (folder / "records").mkdir(parents=True, exist_ok=True)
    with locked(folder):
        freeze(study, order, cfg, folder)
    with Store(folder / "rows.sqlite") as store:
        done = store.done(retry)
        run_cells(study, store, executor, work, done, sum(key not in done for key in order))
        with locked(folder):
            write_results(folder, store, order, study)
            write_pages(folder, cfg)
    _say(folder, study.name)
    return 0


def write_pages(folder: Path, cfg: Mapping[str, Any]) -> None:
    """Figures, report and recording of the study, and the index of all studies, where views are wanted."""
    if cfg["views"]:
        from sysid_bench.views.study import write_index, write_views

        write_views(folder)
        write_index(cfg["results_dir"])


def check_figures(cfg: Mapping[str, Any]) -> None:
    """Refuses a wrong figure spec before the work, not after it."""
    from sysid_bench.views.spec import read_figure

    for node in cfg["figures"] if cfg["views"] else ():
        read_figure(node)


def study_folder(results: Path, name: str) -> Path:
    """results/<name>; refuses a name that leaves the results folder."""
    folder = (results / name).resolve()
    if not name or not folder.is_relative_to(results.resolve()) or folder == results.resolve():
        raise InputError(f"study.name must be a folder inside {results}; got {name!r}.")
    return folder


def _statuses(text: str | None) -> list[str]:
    if not isinstance(text, str | None):
        raise InputError(f"retry must be statuses separated by commas; got {text!r:.60}.")
    words = [word for word in (text or "").split(",") if word]
    for word in words:
        if word not in STATUSES:
            raise InputError(f"retry={text}: {word!r} is no status; there are {', '.join(STATUSES)}.")
    return words


def order_of(study: plan.Study) -> tuple[str, ...]:
    """Keys of all cells, in the order of the grid."""
    return tuple(cell.key for task in plan.tasks(study) for cell in task.cells)


def checked_order(study: plan.Study, only: str | None) -> tuple[str, ...]:
    """As order_of, after building all that the grid names once: a wrong knob is told before the work."""
    points: dict[tuple[str, ...], Task] = {}
    for task in plan.tasks(study):
        points.setdefault(tuple(task.parts.values()), task)
    if not points:
        raise InputError(f"no cell of {study.name} matches only={only!r}.")
    for task in points.values():
        check_task(task)
    return order_of(study)


def freeze(study: plan.Study, order: tuple[str, ...], cfg: Mapping[str, Any], folder: Path) -> None:
    """Write manifest.json: what the workers do was decided before they start."""
    shown = {key: value for key, value in cfg.items() if key not in ("plugins", "words")}
    manifest = {
        "study": study.name,
        "question": study.question,
        "command": shlex.join(["sysid-bench", "sweep", *cfg.get("words", [])]),
        "cells": len(order),
        "plan": plan.digest(order),
        "config": shown,
        "options": {f"{g}={name}": dict(o.node) for (g, name), o in study.options.items()},
        "origin": origin(),
    }
    path = folder / "manifest.json"
    _note_change(path, manifest)
    part = path.with_name("manifest.json.part")
    part.write_text(json.dumps(manifest, indent=1) + "\n")
    part.replace(path)


def _note_change(path: Path, manifest: Mapping[str, Any]) -> None:
    try:
        before = json.loads(path.read_text())["plan"]
    except (OSError, ValueError, KeyError):
        return
    if before != manifest["plan"]:
        print(
            f"{manifest['study']}: configs or code changed since the last run; cells that depend on it run again."
        )


def run_cells(
    study: plan.Study, store: Store, executor: Executor, work: Work, done: set[str], count: int
) -> None:
    """Rows into the store as they come. Killed at any moment, what was stored stays."""
    if not count:
        return
    left = (task.without(done) for task in plan.tasks(study))
    with watched(study.name, count) as progress:
        found = _kept(executor.run(work, (task for task in left if task.cells)))
        for rows in _flushed(found, progress):
            store.add(rows)


def _kept(rows: Iterable[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """The rows; raises InputError at one whose record could not be written: no disk, no sweep."""
    for row in rows:
        if str(row.get("reason", "")).startswith(CANNOT_KEEP):
            raise InputError(row["reason"])
        yield row


def _flushed(rows: Iterable[dict[str, Any]], progress: Any) -> Iterator[list[dict[str, Any]]]:
    """Rows in batches of half a second: one transaction each. What is pending when the run stops is kept."""
    pending: list[dict[str, Any]] = []
    last = time.monotonic()
    try:
        for row in rows:
            pending.append(row)
            progress.advance(failures=row["status"] not in ("ok", "not_applicable"))
            if len(pending) >= FLUSH_ROWS or time.monotonic() - last > FLUSH_S:
                yield pending
                pending, last = [], time.monotonic()
    except KeyboardInterrupt:
        yield pending
        raise
    yield pending


@dataclass(frozen=True)
class _Stored:
    """Rows of a store in plan order, iterable anew."""

    store: Store
    order: tuple[str, ...]

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return self.store.rows(self.order)


def write_results(folder: Path, store: Store, order: tuple[str, ...], study: plan.Study) -> None:
    """table.parquet and summary.csv of the cells of this plan, in its order whatever order they ran in."""
    write_table(_Stored(store, order), folder / "table.parquet")
    swept = [*study.axes, *(key for case in study.cases for key in case)]
    axes = [key for key in dict.fromkeys(swept) if "." in key]
    table = read_table(folder / "table.parquet", summary_columns(axes))
    write_csv(summary(table, axes), folder / "summary.csv")


def _say(folder: Path, name: str) -> None:
    statuses = Counter(read_table(folder / "table.parquet", ["status"])["status"])
    counts = ", ".join(f"{count} {status}" for status, count in statuses.most_common())
    report = folder / "report.html"
    print(f"{name}: {counts}. {report if report.exists() else folder / 'summary.csv'}")
    if shutil.disk_usage(folder).free < 100e6:
        print(f"less than 100 MB are left on the disk of {folder}", file=sys.stderr)
