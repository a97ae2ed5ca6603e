"""the same hidden trials -> what pysindy's sparse regression says of them, beside the workflow's answers.

    python experiments/hidden_effects/pysindy_peer.py run --first 5000 --count 80 --kind single --out results/hidden_effects/pysindy.jsonl
    python experiments/hidden_effects/pysindy_peer.py table results/hidden_effects/pysindy.jsonl results/hidden_effects/report.jsonl

Fairly used: it is given the nominal model and told the structure. Its smoothed derivatives (SmoothedFiniteDifference) feed one
regression for all equations at once: the force that the nominal leaves, on corrections of M, D, K and on every law of the catalogue
that a regression can hold, at every DOF and every sprung pair (coefficient of a pair shared by its two rows). STLSQ with normalised
columns; smoothing window and threshold are those whose model, simulated freely, misses the last third of the training record least.
"""

# ruff: noqa: E402
from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # before numpy is loaded
    os.environ.setdefault(_name, "1")

import argparse
import json
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from attempt import model_of, records_of
from draw import Draw
from judge import judge
from tally import markdown, share
from trial import Trial
from trials import KEY, lines, plain, sealed

from sysid_bench.effects import effect_class
from sysid_bench.gap.prove import prove
from sysid_bench.mechanics.effect import Effect, direction
from sysid_bench.nouns import InputError, Model, Record

WINDOWS = (5, 11, 21, 41)  # samples, Savitzky-Golay of third order
THRESHOLDS = (0.02, 0.05, 0.1, 0.2, 0.4, 0.7)  # of the norm of the force to be explained
RIDGE = 1e-2  # beside columns of norm 1
MOST_ROWS = 20000
HELD_OUT = 1 / 3


@dataclass(frozen=True)
class Term:
    """A column of the regression: a law with unit coefficient, and the effect that a coefficient makes of it."""

    name: str
    dof: int | tuple[int, int]
    values: Callable[[np.ndarray, np.ndarray], np.ndarray]
    make: Callable[[float], dict]


def laws(x: np.ndarray, v: np.ndarray) -> list[tuple[str, Callable, Callable]]:
    """(name, law of x and v, parameters of a coefficient) of what is linear in one coefficient, shapes on a grid."""
    speed, sx, top = 0.01 * v.std(), x.std(), np.abs(x).max()
    found = [
        ("coulomb_friction", lambda x, v: np.tanh(v / speed), lambda c: {"force": c, "speed": speed}),
        ("quadratic_drag", lambda x, v: np.abs(v) * v, lambda c: {"coefficient": c}),
        ("cubic_stiffness", lambda x, v: x**3, lambda c: {"stiffness": c}),
        ("quadratic_stiffness", lambda x, v: x**2, lambda c: {"stiffness": c}),
    ]
    for g in (0.25 * sx, 0.5 * sx, sx):
        found.append(
            ("dead_zone", lambda x, v, g=g: -np.clip(x, -g, g), lambda c, g=g: {"stiffness": c, "gap": g})
        )
    for g in (0.5 * top, 0.65 * top, 0.8 * top):
        for side in (-1, 1):
            over = lambda x, v, g=g, s=side: s * np.maximum(s * x - g, 0)  # noqa: E731
            found.append(
                ("end_stop", over, lambda c, g=g, s=side: {"stiffness": c, "gap": g, "side": float(s)})
            )
    return found


def library(model: Model, q: np.ndarray, v: np.ndarray) -> list[Term]:
    """Every law at every DOF and sprung pair; a constant force at every DOF; a spring between every other pair."""
    n, K = model.n, model.stiffness
    places: list = [*range(n), *((i, j) for i in range(n) for j in range(i + 1, n) if K[i, j] != 0)]
    terms = []
    for place in places:
        c = direction(place, n)
        terms += [Term(name, place, law, make) for name, law, make in laws(q @ c, v @ c)]
        if isinstance(place, int):
            terms.append(Term("constant_force", place, lambda x, v: -np.ones_like(x), lambda c: {"force": c}))
    apart = [(i, j) for i in range(n) for j in range(i + 1, n) if K[i, j] == 0]
    return terms + [Term("missing_coupling", p, lambda x, v: x, lambda c: {"stiffness": c}) for p in apart]


def corrections(model: Model) -> list[tuple[int, int, int]]:
    """(matrix, row, column) of the entries that may be corrected."""
    shape = (np.eye(model.n) > 0, model.stiffness != 0, model.stiffness != 0)
    return [(m, i, j) for m in range(3) for i in range(model.n) for j in range(i, model.n) if shape[m][i, j]]


def design(model: Model, motion: tuple, u: np.ndarray, terms: list[Term]) -> tuple[np.ndarray, np.ndarray]:
    """(columns (N n, p), target (N n,)): r = L u - M a - D v - K q = corrections + laws."""
    q, v, a = motion
    n = model.n
    r = u @ model.input_map.T - a @ model.mass.T - v @ model.damping.T - q @ model.stiffness.T
    step = max(1, len(q) * n // MOST_ROWS)
    columns = []
    for m, i, j in corrections(model):
        column = np.zeros_like(q)
        column[:, i] = (a, v, q)[m][:, j]
        if i != j:
            column[:, j] = (a, v, q)[m][:, i]
        columns.append(column[::step].ravel())
    for term in terms:
        c = direction(term.dof, n)
        columns.append(np.outer(term.values(q @ c, v @ c), c)[::step].ravel())
    return np.column_stack(columns), r[::step].ravel()


def derivatives(record: Record, window: int) -> tuple:
    """q, v, a by pysindy's smoothed differences."""
    import pysindy

    smooth = pysindy.SmoothedFiniteDifference(
        smoother_kws={"window_length": window, "polyorder": 3, "axis": 0}
    )
    v = np.asarray(smooth(record.y, record.t))
    q = np.asarray(smooth.smoothed_x_)
    return q, v, np.asarray(smooth(v, record.t))


def models(record: Record, model: Model) -> list[Model]:
    """One model per window and threshold; those whose signs no effect admits are left out."""
    import pysindy

    warnings.filterwarnings("ignore", "Sparsity parameter is too big")
    found = []
    for window in WINDOWS:
        motion = derivatives(record, window)
        inner = slice(window, -window)
        motion = tuple(x[inner] for x in motion)
        terms = library(model, motion[0], motion[1])
        A, r = design(model, motion, record.u[inner], terms)
        alive = np.linalg.norm(A, axis=0) > 1e-9 * np.linalg.norm(
            r
        )  # a stop that is never reached has no column
        A, x = A[:, alive], np.zeros(len(alive))
        for threshold in THRESHOLDS:
            solver = pysindy.STLSQ(threshold * np.linalg.norm(r), alpha=RIDGE, normalize_columns=True)
            x[alive] = np.asarray(solver.fit(A, r[:, None]).coef_)[0]
            found.append(_model(model, x, terms))
    return [m for m in found if m is not None]


def _model(model: Model, x: np.ndarray, terms: list[Term]) -> Model | None:
    matrices = [np.array(X) for X in (model.mass, model.damping, model.stiffness)]
    entries = corrections(model)
    for (m, i, j), value in zip(entries, x):
        matrices[m][i, j] += value
        if i != j:
            matrices[m][j, i] += value
    effects = [
        made
        for term, value in zip(terms, x[len(entries) :])
        if value and (made := _effect(term, float(value)))
    ]
    if np.linalg.eigvalsh(matrices[0])[0] <= 0:
        return None
    M, D, K = matrices
    return replace(model, mass=M, damping=D, stiffness=K, effects=tuple(effects))


def _effect(term: Term, value: float) -> Effect | None:
    """None where nature does not allow the sign."""
    try:
        return effect_class(term.name)(dof=term.dof, **term.make(value))
    except InputError:
        return None


def chosen(record: Record, model: Model) -> Model:
    """Fitted on the first two thirds, the model with the least free-run error on the rest; the nominal is one of them."""
    cut = int((1 - HELD_OUT) * record.N)
    first, rest = (
        Record(record.t[s], record.u[s], record.y[s], record.hold) for s in (slice(0, cut), slice(cut, None))
    )
    free = replace(model, initial_state="free")
    scored = [
        (_gap(replace(m, initial_state="free"), rest), k, m) for k, m in enumerate([*models(first, model)])
    ]
    scored.append((_gap(free, rest), -1, model))
    return replace(min(scored, key=lambda x: x[:2])[2], initial_state=model.initial_state)


def _gap(model: Model, record: Record) -> float:
    gap = prove(model, record).gap
    return gap if np.isfinite(gap) else np.inf


def answer(trial: Trial) -> dict:
    """As the workflow's: what was said, the held-out gap before and after, seconds."""
    train, test = records_of(trial)
    model, begun = model_of(trial), time.process_time()
    best = chosen(train[0], model)
    seconds = time.process_time() - begun
    names = {(e.name, e.dof): e for e in best.effects}  # one law at several grid points is one name
    said = [{"name": name, "dof": dof, "values": {}, "alike": []} for name, dof in names]
    return {
        "verdict": "effect" if said else "none", "said": said, "gap_before": _gap(model, test[0]),
        "gap_after": _gap(best, test[0]), "cpu_s": seconds,
    }  # fmt: skip


def run(given: argparse.Namespace) -> None:
    given.out.parent.mkdir(parents=True, exist_ok=True)
    done = {(a["kind"], a["seed"]) for a in lines(given.out)}
    for seed in range(given.first, given.first + given.count):
        if (given.kind, seed) in done:
            continue
        trial = Draw(seed, kind=given.kind).trial()
        if trial.truth["bad"]:
            continue
        key = {"seed": seed, "stratum": "main", "kind": given.kind}
        row = {**key, **answer(trial)}
        with given.out.open("a") as file:
            file.write(json.dumps(row, default=plain) + "\n")
        print(seed, trial.truth["effects"], "->", [(e["name"], e["dof"]) for e in row["said"]], flush=True)


def table(peer: Path, ours: Path) -> str:
    """Both on the trials that both answered."""
    truths = {tuple(t[k] for k in KEY): t for t in lines(sealed(ours))}
    mine, theirs = ({tuple(a[k] for k in KEY): a for a in lines(path)} for path in (ours, peer))
    both = [key for key in theirs if key in mine and key in truths]
    body = []
    for kind in ("single", "none"):
        for name, found in (("sysid-bench gap", mine), ("pysindy", theirs)):
            rows = []
            for key in (k for k in both if k[1] == kind):
                row = judge(found[key], truths[key])
                row["group"] = judge(mine[key], truths[key])["group"]  # what is weak, both are told
                rows.append(row)
            rows = [r for r in rows if r["group"] != "single, weak"]
            if rows:
                body.append([f"{kind}: {name}", *_columns(rows)])
    head = (
        "",
        "trials",
        "names all right",
        "right name among them",
        "false name",
        "names said",
        "shrink of oracle's",
        "cpu s",
    )
    return markdown(head, body)


def _columns(rows: list[dict]) -> list[str]:
    single = bool(rows[0]["true"])
    shrinks = [np.clip(r["shrink"], -1, 1) for r in rows if r["shrink"] is not None]
    among = share(rows, lambda r: r["true"][0][0] in [n for n, _ in r["said"]]) if single else ""
    return [
        str(len(rows)), share(rows, "names_right") if single else "", among, share(rows, "false_name"),
        f"{np.mean([len(r['said']) for r in rows]):.1f}",
        f"{100 * np.median(shrinks):.0f} (median)" if shrinks else "",
        f"{np.median([r['cpu_s'] for r in rows]):.1f}",
    ]  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    verbs = parser.add_subparsers(dest="verb", required=True)
    trial = verbs.add_parser("run")
    trial.add_argument("--first", type=int, required=True)
    trial.add_argument("--count", type=int, required=True)
    trial.add_argument("--kind", choices=("single", "none"), default="single")
    trial.add_argument("--out", type=Path, required=True)
    shown = verbs.add_parser("table")
    shown.add_argument("file", type=Path)
    shown.add_argument("ours", type=Path)
    given = parser.parse_args()
    if given.verb == "run":
        run(given)
    else:
        print(table(given.file, given.ours))
