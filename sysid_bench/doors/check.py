"""the reference studies, run again -> exit 1, the rows that got worse and the command of each."""

from __future__ import annotations

import difflib
import secrets
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench import conf, regress
from sysid_bench.build import build
from sysid_bench.doors import sweep
from sysid_bench.nouns import InputError
from sysid_bench.plan import Study, command
from sysid_bench.regress import Change, Claim
from sysid_bench.store import Store
from sysid_bench.studies import study_of
from sysid_bench.table import write_csv

DIGITS = 10
DIGITS_PER_SEED = 5  # far below the floor of the statistics, above what rounding moves
DIFF_LINES = 40
COMMANDS = 20  # printed; more rows than this are one cause


@dataclass(frozen=True)
class _Run:
    """A study, run again: its rows in plan order, and the labels that tell its points apart."""

    name: str
    rows: Sequence[Mapping[str, Any]]
    labels: Sequence[str]
    seed: int
    claims: Sequence[Claim]


@dataclass(frozen=True)
class _Outcome:
    """What a tier says: what changed, the tables to keep (ending -> rows and digits), lines to print."""

    changes: Sequence[Change]
    tables: Mapping[str, tuple[Sequence[Mapping[str, Any]], int]]
    remarks: Sequence[str] = field(default_factory=list)


def main(cfg: dict[str, Any]) -> int:
    """0 where nothing got worse, 1 with the rows that did; accept=true writes the reference anew."""
    if cfg["tier"] not in _TIERS:
        raise InputError(f"tier must be one of {', '.join(_TIERS)}; got {cfg['tier']!r}.")
    if cfg["accept"] and cfg["only"]:
        raise InputError("accept=true takes a whole table over; leave only= out.")
    names = [cfg["experiment"]] if cfg["experiment"] else cfg["experiments"][cfg["tier"]]
    worse = 0
    for name in names:
        worse += _check(name, cfg)
    return 1 if worse else 0


def _check(name: str, cfg: dict[str, Any]) -> int:
    path = Path(cfg["reference"]) / f"{reference_name(name, cfg['tier'])}.csv"
    known = [] if cfg["accept"] and not path.is_file() else regress.read_reference(path)
    with tempfile.TemporaryDirectory() as temporary:
        run = _rerun(name, Path(cfg["results_dir"] or temporary), cfg)
    outcome = _TIERS[cfg["tier"]](run, known, cfg)
    for line in outcome.remarks:
        print(line)
    if cfg["accept"]:
        _accept(run, path, outcome)
        return 0
    plugins = ",".join(map(str, cfg["plugins"].folders))
    return _tell(run, outcome.changes, cfg["tier"], f" plugins={plugins}" if plugins else "")


def reference_name(study: str, tier: str) -> str:
    """Name of a study's reference table: each tier keeps one of its own."""
    name = str(study).removeprefix("reference/").replace("/", "__")
    return name if tier in ("exact", name) else f"{name}.{tier}"


def _rerun(name: str, results: Path, cfg: dict[str, Any]) -> _Run:
    seed = cfg["seed"] if cfg["seed"] is not None else secrets.randbelow(2**31)
    words = [f"experiment={name}", f"results_dir={results}", "views=false", "records=none"]
    words += [f"only={cfg['only']}"] if cfg["only"] else []
    words += [f"study.seed={seed}"] if cfg["tier"] == "fresh" else []
    composed = conf.compose("sweep", words, cfg["plugins"]) | {
        "plugins": cfg["plugins"], "words": words, "executor": cfg["executor"],
    }  # fmt: skip
    study: Study = study_of(composed)
    sweep.run(study, composed)
    with Store(results / study.name / "rows.sqlite") as store:
        rows = list(store.rows(sweep.order_of(study)))
    swept = dict.fromkeys([*study.axes, *(key for case in study.cases for key in case)])
    return _Run(name, rows, [*dict.fromkeys(["plant", "method", *swept])], study.seed, _claims(composed))


def _claims(composed: Mapping[str, Any]) -> list[Claim]:
    return [build({"_target_": "sysid_bench.regress.Claim", **node}) for node in composed["claims"]]


def _exact(run: _Run, known: Sequence[Mapping[str, str]], cfg: Mapping[str, Any]) -> _Outcome:
    labels = [*run.labels, "repetition"]
    known = regress.part_of(known, _pairs(cfg["only"]))
    changes = regress.compare_exact(run.rows, known, labels, float(cfg["rtol"])) if known else []
    return _Outcome(changes, {"": (regress.reference_rows(run.rows, labels), DIGITS)})


def _paired(run: _Run, known: Sequence[Mapping[str, str]], cfg: Mapping[str, Any]) -> _Outcome:
    runs = 1 + max(row["repetition"] for row in run.rows)
    if runs < regress.FEWEST_PAIRS and not cfg["only"]:
        raise InputError(
            f"tier=paired needs at least {regress.FEWEST_PAIRS} runs of each point; {run.name} has {runs}. "
            "study.repetitions: 100 finds a shift of 2 %."
        )
    known = regress.part_of(known, _pairs(cfg["only"]))
    limits = float(cfg["level"]), float(cfg["floor"])
    changes = regress.compare_paired(run.rows, known, run.labels, *limits) if known else []
    kept = regress.reference_rows(run.rows, [*run.labels, "repetition"], regress.ERRORS)
    medians = regress.medians(run.rows, run.labels)
    return _Outcome(changes, {"": (kept, DIGITS_PER_SEED), ".medians": (medians, DIGITS_PER_SEED)})


def _fresh(run: _Run, known: Sequence[Mapping[str, str]], cfg: Mapping[str, Any]) -> _Outcome:
    if not run.claims:
        raise InputError(f"tier=fresh judges the claims of a study; {run.name} has no `claims:`.")
    rng = np.random.default_rng(run.seed)
    measured = [regress.measure(claim, run.rows, rng) for claim in run.claims]
    said = [f"{'holds' if m.holds else 'DOES NOT HOLD'}: {m}" for m in measured]
    said.append(f"Again with: sysid-bench check tier=fresh experiment={run.name} seed={run.seed}")
    return _Outcome(
        regress.judge(measured, known), {"": ([m.row() for m in measured], DIGITS_PER_SEED)}, said
    )


_TIERS = {"exact": _exact, "paired": _paired, "fresh": _fresh}


def _pairs(only: str | None) -> dict[str, str]:
    return dict(word.split("=", 1) for word in (only or "").split())


def _accept(run: _Run, path: Path, outcome: _Outcome) -> None:
    """Write the tables anew and show what that changes; the last one is the table for people."""
    path.parent.mkdir(parents=True, exist_ok=True)
    for change in outcome.changes[:DIFF_LINES]:
        print(change)
    for ending, (rows, digits) in outcome.tables.items():
        target = path.with_name(path.stem + ending + path.suffix)
        before = target.read_text() if target.is_file() else ""
        write_csv(rows, target, digits=digits)
    _show_difference(before, target)
    print(f"{path}: {len(run.rows)} cells are the reference now; review the diff and commit it.")


def _show_difference(before: str, path: Path) -> None:
    now = path.read_text()
    lines = list(
        difflib.unified_diff(before.splitlines(), now.splitlines(), "before", str(path), n=0, lineterm="")
    )
    print("\n".join(lines[:DIFF_LINES]) if lines else f"{path}: as it was.")
    if len(lines) > DIFF_LINES:
        print(f"... {len(lines) - DIFF_LINES} lines more: git diff {path}")


def _tell(run: _Run, changes: Sequence[Change], tier: str, plugins: str) -> int:
    commands = []
    for change in changes:
        print(change)
        if "claim" not in change.cell:
            axes = [key for key in change.cell if key != "repetition"]
            cell = {key: value for key, value in change.cell.items() if value != ""}
            commands.append(command(run.name, cell, axes) + plugins)
    worse = sum(change.verdict == "worse" for change in changes)
    better = len(changes) - worse
    print(f"{run.name}: {len(run.rows)} cells, {worse} numbers worse, {better} better than the reference.")
    unique = list(dict.fromkeys(commands))
    if unique:
        print("Reproduce with:", *(f"    {text}" for text in unique[:COMMANDS]), sep="\n")
    if len(unique) > COMMANDS:
        print(f"    ... and {len(unique) - COMMANDS} more rows, as above")
    if better and not worse:
        print(f"Take the better numbers over with: sysid-bench check tier={tier} accept=true")
    return worse
