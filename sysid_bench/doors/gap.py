"""train and test records, model file -> gap.json, model.yaml, prediction.csv, report.html, gap.rrd."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench import conf
from sysid_bench.asked import require
from sysid_bench.build import build
from sysid_bench.effects import own_effects
from sysid_bench.files import atomic_write, read_model, results_folder, write_json, write_model
from sysid_bench.files.provenance import provenance
from sysid_bench.files.yaml_text import yaml_text
from sysid_bench.gap.answer import Answer
from sysid_bench.gap.experiment import Settling, proposals, settling
from sysid_bench.gap.rivals import alike
from sysid_bench.gap.show import gap_values
from sysid_bench.gap.story import Rules
from sysid_bench.gap.thresholds import Thresholds
from sysid_bench.gap.workflow import find_gap
from sysid_bench.nouns import InputError, Record
from sysid_bench.pairing import pair
from sysid_bench.records import read_record


def main(cfg: dict[str, Any]) -> int:
    """0 whatever the verdict; InputError where records and model do not fit."""
    begun = time.perf_counter()
    require(cfg, "gap", "train", "test", "model", "out")
    train_files, test_files = files(cfg["train"]), files(cfg["test"])
    own = own_effects(cfg["effects_path"])
    model = read_model(cfg["model"], own)
    paired = [[pair(read_record(f), model) for f in group] for group in (train_files, test_files)]
    train, test = ([record for record, _, _ in group] for group in paired)
    rules, thresholds = (
        build({"_target_": f"{kind.__module__}.{kind.__name__}", **cfg[name]})
        for name, kind in (("rules", Rules), ("thresholds", Thresholds))
    )

    def tell(line: str) -> None:
        print(f"[{time.perf_counter() - begun:6.2f} s] {line}", file=sys.stderr, flush=True)

    out = results_folder(cfg["out"])  # before the work, and only once the input is read
    for remark in dict.fromkeys(r for group in paired for _, _, remarks in group for r in remarks):
        tell(f"note: {remark}")
    if seen := [f for f in test_files if any(Path(f).samefile(other) for other in train_files)]:
        tell(f"note: {', '.join(seen)} is among the training records: on it the held-out gap proves nothing")
    answer = find_gap(train, test, model, own, rules, thresholds, tell, cfg["power"])
    origin = provenance("gap", cfg, [*train_files, *test_files, cfg["model"]])
    settled = experiment(answer, cfg)
    values = gap_values(answer, thresholds, origin, settled)
    write_results(out, answer, values, origin)
    write_experiment(out, settled)
    if cfg["views"]:
        from sysid_bench.views.gap_report import write_gap_report

        write_gap_report(out, answer, values)
    if cfg["recording"]:
        from sysid_bench.views.rerun_gap import write_gap_rrd

        write_gap_rrd(out / "gap.rrd", answer, values)
    print_answer(values, out)
    return 0


def experiment(answer: Answer, cfg: dict[str, Any]) -> Settling | None:
    """The excitation that would tell apart what these records do not, chosen among `proposals`."""
    classes = alike(answer)
    if not classes:
        return None
    packages, candidates = cfg["plugins"].packages, []
    for proposal in proposals(answer):
        node = conf.option("excitation", proposal["option"]) | {
            k: v for k, v in proposal.items() if k != "option"
        }
        candidates.append((node, build(node, packages)))
    return settling(answer, classes, candidates)


def write_experiment(out: Path, settled: Settling | None) -> None:
    """experiment.yaml, which simulate and measure take as excitation=FILE; none where nothing is left to settle."""
    path = out / "experiment.yaml"
    path.unlink(missing_ok=True)
    if settled is None or not settled.settles:
        return
    names = " or ".join(settled.between)
    head = (
        f"# Would tell {names}: {settled.seconds:.4g} s of it.\n"
        f"# sysid-bench measure excitation={path} seconds={settled.seconds:.4g} ...\n"
        f"# sysid-bench simulate excitation={path} model={out / 'model.yaml'} ...\n"
    )
    with atomic_write(path, "w") as file:
        file.write(head + yaml_text(dict(settled.config)))


def files(value: Any) -> list[str]:
    """File names of FILE[,FILE...] or a list. Raises InputError where there are none."""
    names = list(value) if isinstance(value, (list, tuple)) else [x.strip() for x in str(value).split(",")]
    names = [str(x) for x in names if str(x)]
    if not names:
        raise InputError("train= and test= want a record file each, or several separated by commas.")
    return names


def write_results(out: Path, answer: Answer, values: dict[str, Any], origin: dict[str, Any]) -> None:
    """gap.json, model.yaml, prediction.csv (one per test record where there are several)."""
    write_model(
        replace(answer.better, sample_time_s=None),
        out / "model.yaml",
        {"verb": "gap", "inputs": origin.get("inputs", {})},
    )
    for i, proof in enumerate(answer.after):
        name = "prediction.csv" if i == 0 else f"prediction_{i}.csv"
        write_prediction(out / name, proof.record, proof.trace.t, proof.predicted)
    write_json(out / "gap.json", values)


def write_prediction(path: Path, record: Record, t, predicted) -> None:
    """t, y1..yny: the free run, at the record's own sample times."""
    if len(t) != record.N:
        step = (t[-1] - t[0]) / (len(t) - 1)
        predicted = predicted[np.rint((record.t - t[0]) / step).astype(int)]
    header = ",".join(["t", *(f"y{c + 1}" for c in range(predicted.shape[1]))])
    rows = np.column_stack([record.t, predicted]).tolist()
    text = "\n".join([header, *(",".join(map(repr, row)) for row in rows)]) + "\n"
    with atomic_write(path) as file:
        file.write(text.encode())


def print_answer(values: dict[str, Any], out: Path) -> None:
    """The answer in a few lines."""
    print(f"{values['verdict']}: {values['reason']}")
    for effect in values["effects"]:
        sizes = ", ".join(
            f"{key} {p['value']:.4g}"
            + (f" ± {2 * p['std']:.2g}" if p["std"] is not None else "")
            + f" {p['unit']}"
            if not isinstance(p["value"], str)
            else f"{key} {p['value']}"
            for key, p in effect["parameters"].items()
        )
        print(f"  {effect['name']} at {effect['dof']}: {sizes}")
    if values["experiment"]:
        told = " or ".join(values["experiment"]["between"])
        way = (
            f"{out / 'experiment.yaml'} would"
            if values["experiment"]["settles"]
            else "no excitation tried would"
        )
        print(f"  {told}: not told apart by these records; {way}.")
    if values["force_gap"]:
        given, refitted, better, floor = (100 * x for x in values["force_gap"].values())
        print(
            f"held-out force error {given:.3g} % as given, {refitted:.3g} % refitted -> {better:.3g} %"
            f" (noise floor {floor:.2g} %). {out / 'gap.json'}"
        )
        return
    print(
        f"held-out gap {100 * values['gap_before']:.3g} % -> {100 * values['gap_after']:.3g} %"
        f" (noise floor {100 * values['noise_floor']:.3g} %). {out / 'gap.json'}"
    )
