"""the reference studies, run again -> exit 1 and the rows that got worse."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from sysid_bench import conf
from sysid_bench.doors import sweep
from sysid_bench.plan import Study
from sysid_bench.regress import Change, compare_exact, read_reference, reference_rows
from sysid_bench.store import Store
from sysid_bench.studies import study_of
from sysid_bench.table import write_csv

DIGITS = 10


def main(cfg: dict[str, Any]) -> int:
    """0 where nothing got worse, 1 with the rows that did; accept=true writes the reference anew."""
    names = [cfg["experiment"]] if cfg["experiment"] else cfg["experiments"]
    worse = 0
    for name in names:
        worse += _check(name, cfg)
    return 1 if worse else 0


def _check(name: str, cfg: dict[str, Any]) -> int:
    path = Path(cfg["reference"]) / f"{name.removeprefix('reference/').replace('/', '__')}.csv"
    known = None if cfg["accept"] else read_reference(path)
    with tempfile.TemporaryDirectory() as temporary:
        rows, labels = _rerun(name, Path(cfg["results_dir"] or temporary), cfg)
    if known is None:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_csv(reference_rows(rows, labels), path, digits=DIGITS)
        print(f"{path}: {len(rows)} cells are the reference now; review the diff and commit it.")
        return 0
    changes = compare_exact(rows, known, labels, float(cfg["rtol"]))
    return _tell(name, len(rows), changes)


def _rerun(name: str, results: Path, cfg: dict[str, Any]) -> tuple[list[dict[str, Any]], list[str]]:
    words = [f"experiment={name}", f"results_dir={results}", "views=false", "records=none"]
    composed = conf.compose("sweep", words, cfg["plugins"]) | {"plugins": cfg["plugins"], "words": words}
    sweep.main(composed)
    study: Study = study_of(composed)
    with Store(results / study.name / "rows.sqlite") as store:
        rows = list(store.rows(sweep.order_of(study)))
    swept = [key for key in dict.fromkeys([*study.axes, *(k for c in study.cases for k in c)])]
    return rows, [*dict.fromkeys(["plant", "method", *swept]), "repetition"]


def _tell(name: str, cells: int, changes: list[Change]) -> int:
    for change in changes:
        print(change)
    worse = sum(change.verdict == "worse" for change in changes)
    better = len(changes) - worse
    print(f"{name}: {cells} cells, {worse} numbers worse, {better} better than the reference.")
    if worse:
        print(
            f"Reproduce with: sysid-bench sweep experiment={name} 'only=KEY=VALUE ...' (keys as in the rows above)."
        )
    if better and not worse:
        print("Take the better numbers over with: sysid-bench check accept=true")
    return worse
