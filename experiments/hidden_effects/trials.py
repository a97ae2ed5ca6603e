"""seeds -> one scored line per hidden trial, appended to a .jsonl file; and the summary of such a file.

    OPENBLAS_NUM_THREADS=1 python experiments/hidden_effects/trials.py run --first 5000 --count 30 --out results/hidden_effects/report.jsonl
    python experiments/hidden_effects/trials.py table results/hidden_effects/report.jsonl

Seeds below 5000 are for tuning; the figures that are reported come from seeds never touched before (5000 on).
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
from draw import Draw, Trial

from sysid_bench.gap.workflow import Answer, find_gap
from sysid_bench.nouns import Model, Record

WORTH = 1.5  # refit-linear error over noise-limited error from which a single effect counts in the main table


def records_of(trial: Trial) -> tuple[list[Record], list[Record]]:
    made = []
    for (u, y), quality in zip((trial.train, trial.test), trial.quality):
        made.append([Record(np.arange(len(u)) * trial.h, u, y, hold=trial.hold, quality=quality)])
    return made[0], made[1]


def model_of(trial: Trial) -> Model:
    return Model(
        trial.M, trial.D, trial.K, input_map=trial.L, output_map=trial.C, hold=trial.hold, initial_state=trial.initial_state,
    )  # fmt: skip


def place(dof):
    return tuple(sorted(dof)) if isinstance(dof, (list, tuple)) else dof


def judge(answer: Answer, truth: dict) -> dict:
    """What the sealed truth says of an answer."""
    said = [(e.name, place(e.dof)) for e in answer.added] if answer.verdict.word == "effect" else []
    true = [(e["name"], place(e["dof"])) for e in truth["effects"]]
    names, said_names = [n for n, _ in true], [n for n, _ in said]
    hits = sum(min(names.count(n), said_names.count(n)) for n in set(names))
    f1 = 2 * hits / max(len(names) + len(said_names), 1) if names else float(not said)
    return {
        "verdict_right": answer.verdict.word == truth["verdict"],
        "names_right": sorted(names) == sorted(said_names),
        "f1": f1,
        "located": bool(true) and all(x in said for x in true),
        "false_names": len(said_names) - hits,
    }


def one(seed: int, **drawn) -> dict | None:
    """Draw, answer, open the seal. None where the drawn plant is no fair case (it diverges)."""
    draw = Draw(seed, **drawn)
    trial = draw.trial()
    truth = trial.truth
    if truth["bad"]:
        return None
    train, test = records_of(trial)
    begun = time.process_time()
    answer = find_gap(train, test, model_of(trial), power=False)
    seconds = time.process_time() - begun
    story = answer.story
    return {
        "seed": seed, **{k: truth.get(k) for k in ("size", "kind", "excitation", "hold", "snr_db", "outside")},
        "true": [[e["name"], e["dof"]] for e in truth["effects"]],
        "verdict": answer.verdict.word, "said": [[e.name, e.dof] for e in answer.added],
        "nominal_rho": answer.nominal_rho, "linear_rho": story.linear.rho, "rho": story.fit.rho,
        "gap_before": answer.gap_before, "gap_after": answer.gap_after, "floor": answer.floor, "cpu_s": seconds,
        **judge(answer, truth),
        "rounds": [
            [[c.effect.name, c.effect.dof, round(c.fit.rho, 3), round(c.cost - r.contenders[0].cost, 1)] for c in r.contenders[:5]]
            for r in story.rounds
        ],
    }  # fmt: skip


def table(rows: list[dict]) -> str:
    """Accuracy per kind of trial."""
    lines = [
        "kind        trials  verdict  names  located    F1  false names  after/floor  cpu s (one, three, eight)"
    ]
    kinds = ["single", "single weak", "double", "none", "parameters", "unknown"]
    for kind in kinds:
        chosen = [r for r in rows if stratum(r) == kind]
        if not chosen:
            continue
        mean = {k: np.mean([r[k] for r in chosen]) for k in ("verdict_right", "names_right", "located", "f1")}
        false = np.mean([r["false_names"] > 0 for r in chosen])
        shrink = np.median([r["gap_after"] / max(r["floor"], 1e-12) for r in chosen])
        cpu = [
            np.median([r["cpu_s"] for r in chosen if r["size"] == s] or [np.nan])
            for s in ("one", "three", "eight")
        ]
        lines.append(
            f"{kind:12s}{len(chosen):6d}{mean['verdict_right']:9.3f}{mean['names_right']:7.3f}{mean['located']:9.3f}"
            f"{mean['f1']:6.2f}{false:13.3f}{shrink:13.2f}  " + " ".join(f"{c:.1f}" for c in cpu)
        )
    return "\n".join(lines)


def stratum(row: dict) -> str:
    """A single effect that the refit almost swallows is counted apart."""
    data = any(name in ("quantisation", "sensor_clipping") for name, _ in row["true"])
    weak = row["kind"] == "single" and row["linear_rho"] < WORTH**2 and not data
    return "single weak" if weak else row["kind"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    run = verbs.add_parser("run")
    run.add_argument("--first", type=int, required=True)
    run.add_argument("--count", type=int, required=True)
    run.add_argument("--out", type=Path, required=True)
    run.add_argument("--kind")
    run.add_argument("--size")
    run.add_argument("--name")
    show = verbs.add_parser("table")
    show.add_argument("file", type=Path)
    given = parser.parse_args()
    if given.verb == "table":
        rows = [json.loads(line) for line in given.file.read_text().splitlines()]
        print(table(rows))
        return
    given.out.parent.mkdir(parents=True, exist_ok=True)
    for seed in range(given.first, given.first + given.count):
        row = one(seed, kind=given.kind, size=given.size, name=given.name)
        if row is None:
            continue
        with given.out.open("a") as file:
            file.write(
                json.dumps(row, default=lambda x: x.tolist() if hasattr(x, "tolist") else str(x)) + "\n"
            )
        right = row["names_right"] and row["verdict_right"] and (row["located"] or not row["true"])
        print(
            "ok   " if right else "WRONG",
            seed,
            row["size"],
            row["excitation"],
            f"{row['snr_db']:.0f} dB",
            row["true"],
            row["outside"] or "",
            "->",
            row["verdict"],
            row["said"],
            f"lin {row['linear_rho']:.3g} rho {row['rho']:.3g} {row['cpu_s']:.1f} s",
            flush=True,
        )
        if not right:
            for r in row["rounds"]:
                print("        ", r, flush=True)


if __name__ == "__main__":
    main()
