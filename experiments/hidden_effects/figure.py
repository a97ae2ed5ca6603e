"""judged trials -> the confusion matrix, and accuracy against strength, as png and svg."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
from tally import EDGES, wilson

WORDS = ("unknown", "parameters", "none", "crash")


def draw_figures(rows: list[dict], folder: Path) -> list[Path]:
    """confusion.png/.svg and strength.png/.svg of the main stratum."""
    import matplotlib

    matplotlib.use("Agg")
    rows = [r for r in rows if r["stratum"] == "main"]
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    for name, figure in (("confusion", confusion(rows)), ("strength", strength(rows))):
        for suffix in ("png", "svg"):
            path = folder / f"hidden_effects_{name}.{suffix}"
            metadata = {"Date": None} if suffix == "svg" else None
            figure.savefig(path, dpi=130, bbox_inches="tight", metadata=metadata)
            made.append(path)
    return made


def counted(rows: list[dict]) -> tuple[list[str], list[str], np.ndarray]:
    """(true names, said names, counts): single effects, what lies outside the catalogue, nothing, parameters."""
    rows = [r for r in rows if r["kind"] != "double"]
    truths = [r["true"][0][0] if r["true"] else _other(r) for r in rows]
    said = [r["said"][0][0] if r["verdict"] == "effect" and r["said"] else r["verdict"] for r in rows]
    effects = sorted({t for t, r in zip(truths, rows) if r["true"]})
    down = [*effects, *sorted({t for t, r in zip(truths, rows) if not r["true"]})]
    extra = sorted(set(said) - set(effects) - set(WORDS))
    across = [*effects, *extra, *(w for w in WORDS if w in said)]
    counts = np.zeros((len(down), len(across)), dtype=int)
    for t, s in zip(truths, said):
        counts[down.index(t), across.index(s)] += 1
    return down, across, counts


def _other(r: dict) -> str:
    return f"({r['outside']})" if r["outside"] else r["kind"]


def confusion(rows: list[dict]):
    """One row per truth, one column per answer; the numbers are trials, the shade their share of the row."""
    from matplotlib import pyplot as plt

    down, across, counts = counted(rows)
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    figure, axes = plt.subplots(figsize=(0.34 * len(across) + 3.2, 0.27 * len(down) + 2.4))
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1.25, aspect="auto")
    for i, j in zip(*np.nonzero(counts)):
        axes.text(
            j,
            i,
            str(counts[i, j]),
            ha="center",
            va="center",
            fontsize=8,
            color="white" if share[i, j] > 0.6 else "black",
        )
    axes.set_xticks(range(len(across)), [a.replace("_", " ") for a in across], rotation=90, fontsize=8)
    axes.set_yticks(range(len(down)), [d.replace("_", " ") for d in down], fontsize=8)
    axes.set_xticks(np.arange(len(across)) - 0.5, minor=True)
    axes.set_yticks(np.arange(len(down)) - 0.5, minor=True)
    axes.grid(which="minor", color="0.88", linewidth=0.5)
    axes.tick_params(which="both", length=0)
    axes.set_xlabel("answer: first name, or the verdict where none was given")
    axes.set_ylabel("truth; in brackets: outside the catalogue")
    total, right = counts.sum(), sum(counts[i, across.index(d)] for i, d in enumerate(down) if d in across)
    right += sum(
        counts[i, across.index("unknown")]
        for i, d in enumerate(down)
        if d.startswith("(") and "unknown" in across
    )
    axes.set_title(f"{total} hidden trials, {right} answered right", fontsize=10)
    return figure


def strength(rows: list[dict]):
    """Shares of singles named and located right, with 95 % intervals, by linear error over noise."""
    from matplotlib import pyplot as plt

    singles = [r for r in rows if r["kind"] == "single"]
    figure, axes = plt.subplots(figsize=(6, 3.4))
    bins = list(pairwise(EDGES))
    for shift, (key, label) in zip((-0.08, 0.08), (("names_right", "named"), ("located", "located"))):
        at, middle, bars = [], [], []
        for k, (low, high) in enumerate(bins):
            chosen = [r for r in singles if low <= np.sqrt(r["linear_rho"]) < high]
            if not chosen:
                continue
            hits = sum(bool(r[key]) for r in chosen)
            p, (a, b) = hits / len(chosen), wilson(hits, len(chosen))
            at.append(k + shift), middle.append(p), bars.append((p - a, b - p))
        axes.errorbar(at, middle, yerr=np.clip(np.array(bars).T, 0, 1), fmt="o", capsize=3, label=label)
    counts = [sum(low <= np.sqrt(r["linear_rho"]) < high for r in singles) for low, high in bins]
    names = [
        f"{low:g}-{high:g}\nn={c}" if np.isfinite(high) else f">{low:g}\nn={c}"
        for (low, high), c in zip(bins, counts)
    ]
    axes.set_xticks(range(len(bins)), names, fontsize=8)
    axes.set_ylim(0, 1.02)
    axes.set_xlabel("error of the refitted linear model over the noise floor")
    axes.set_ylabel("share of single effects")
    axes.legend(loc="lower right", fontsize=8)
    axes.grid(axis="y", color="0.9")
    return figure
