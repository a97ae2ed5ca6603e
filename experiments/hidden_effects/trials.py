"""seeds -> answers to hidden trials, the truth sealed beside; then the seal opened: tables and figures.

    python experiments/hidden_effects/trials.py run --first 5000 --count 400 --kind single --jobs 2 --out results/hidden_effects/report.jsonl
    python experiments/hidden_effects/trials.py run --first 5000 --count 100 --stratum "coloured noise" --out results/hidden_effects/report.jsonl
    python experiments/hidden_effects/trials.py table results/hidden_effects/report.jsonl [--csv FILE]
    python experiments/hidden_effects/trials.py figure results/hidden_effects/report.jsonl --out docs/figures

`run` appends answers to FILE.jsonl and truths to FILE.sealed.jsonl, skips what is there, and goes on where it was stopped.
Seeds below 5000 are for tuning; the figures that are reported come from seeds never touched before (5000 on).
"""

# ruff: noqa: E402
from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # before numpy is loaded
    os.environ.setdefault(_name, "1")

import argparse
import json
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from attempt import attempt
from judge import judge
from tally import by_name, by_strength, coverage, csv, table
from trial import STRATA

KEY = ("stratum", "kind", "seed")


def sealed(path: Path) -> Path:
    return path.with_suffix(".sealed.jsonl")


def plain(x):
    return x.tolist() if hasattr(x, "tolist") else str(x)


def lines(path: Path) -> list[dict]:
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def judged(path: Path) -> list[dict]:
    """Every answered trial of a file, scored."""
    truths = {tuple(t[k] for k in KEY): t for t in lines(sealed(path))}
    keys = {tuple(a[k] for k in KEY): a for a in lines(path)}
    return [judge(answer, truths[key]) for key, answer in keys.items() if key in truths]


def asked(given: argparse.Namespace) -> list[int]:
    """Seeds that the file does not hold yet."""
    done = {
        line["asked"]
        for line in lines(sealed(given.out))
        if (line["stratum"], line["wanted"]) == (given.stratum, given.kind)
    }
    return [s for s in range(given.first, given.first + given.count) if s not in done]


def attempts(given: argparse.Namespace) -> Iterator[tuple[int, tuple[dict, dict] | None]]:
    """(seed, answer and truth) as they come, on `jobs` processes."""
    seeds = asked(given)
    one = partial(
        attempt,
        oracle_every=given.oracle_every,
        kind=given.kind,
        size=given.size,
        name=given.name,
        stratum=given.stratum,
    )
    if given.jobs == 1:
        yield from ((seed, one(seed)) for seed in seeds)
        return
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        yield from zip(seeds, pool.map(one, seeds))


def run(given: argparse.Namespace) -> None:
    given.out.parent.mkdir(parents=True, exist_ok=True)
    for seed, both in attempts(given):
        if both is None:
            continue
        answer, truth = both
        truth |= {"asked": seed, "wanted": given.kind}
        for path, line in ((given.out, answer), (sealed(given.out), truth)):
            with path.open("a") as file:
                file.write(json.dumps(line, default=plain) + "\n")
        tell(answer, truth)


def tell(answer: dict, truth: dict) -> None:
    """One line per trial as it ends; what nearly won where it went wrong."""
    row = judge(*(json.loads(json.dumps(x, default=plain)) for x in (answer, truth)))
    right = row["names_right"] and row["verdict_right"] and (row["located"] or not row["true"])
    print(
        "ok   " if right else "WRONG", row["seed"], row["size"], row["excitation"], f"{row['snr_db']:.0f} dB", row["true"],
        row["outside"] or "", "->", row["verdict"], row["said"] or answer.get("reason", ""),
        f"lin {row['linear_rho']:.3g} rho {row['rho']:.3g} {row['cpu_s']:.1f} s", flush=True,
    )  # fmt: skip
    for one in [] if right else answer.get("rounds", []):
        print("        ", one, flush=True)


def show(given: argparse.Namespace) -> None:
    rows = judged(given.file)
    main = [r for r in rows if r["stratum"] == "main"]
    for part in (table(rows), by_strength(rows), by_name(rows), coverage(main)):
        print(part + "\n")
    if given.csv:
        given.csv.parent.mkdir(parents=True, exist_ok=True)
        given.csv.write_text(csv(rows))


def figures(given: argparse.Namespace) -> None:
    from figure import draw_figures

    for path in draw_figures(judged(given.file), given.out):
        print(path)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    verbs = parser.add_subparsers(dest="verb", required=True)
    trial = verbs.add_parser("run")
    trial.add_argument("--first", type=int, required=True)
    trial.add_argument("--count", type=int, required=True)
    trial.add_argument("--out", type=Path, required=True)
    trial.add_argument("--jobs", type=int, default=1)
    trial.add_argument(
        "--oracle-every", type=int, default=1, help="ask the oracle where this divides the seed"
    )
    trial.add_argument("--stratum", choices=list(STRATA), default="main")
    for word in ("kind", "size", "name"):
        trial.add_argument(f"--{word}")
    shown = verbs.add_parser("table")
    shown.add_argument("file", type=Path)
    shown.add_argument("--csv", type=Path)
    drawn = verbs.add_parser("figure")
    drawn.add_argument("file", type=Path)
    drawn.add_argument("--out", type=Path, default=Path("docs/figures"))
    return parser.parse_args()


if __name__ == "__main__":
    chosen = arguments()
    {"run": run, "table": show, "figure": figures}[chosen.verb](chosen)
