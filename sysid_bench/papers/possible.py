"""tables -> what the same records hold: the methods of the thesis beside maximum likelihood with the right hold."""

from __future__ import annotations

import numpy as np

from sysid_bench.papers.bruschetta_2011 import EIGHT, EXACT_START, MDK, NEW, OLD, THREE, error
from sysid_bench.papers.claims import Claim, Verdict, number, word
from sysid_bench.papers.evidence import Table, Tables

BEST = "spline_ml"


def rms_over_bound(rows: Table, X: str) -> float:
    """sqrt(mean((error / bound of the very record)^2)); infinite where a run gave no estimate."""
    return float(np.sqrt(np.mean(rows.values(f"{X}_over_bound") ** 2)))


def on_the_bound(tables: Tables) -> Verdict:
    """Limit: the acceptance figure of 30 runs, 1.25."""
    words, worst = [], 0.0
    for name, size in ((THREE, "3x3 15 dB"), (EIGHT, "8x8 20 dB")):
        table = tables[name].at(method=BEST)
        ratios = {
            h: [rms_over_bound(table.at(sampling__h_s=h), X) for X in MDK]
            for h in table.points("sampling.h_s")
        }
        failed = int(np.sum(table.column("status") != "ok"))
        words.append(
            f"{size}, h = {min(ratios):g} .. {max(ratios):g}: {number(np.min(list(ratios.values())))} .. {number(np.max(list(ratios.values())), 3)}, {failed} of {table.rows} runs failed"
        )
        worst = max(worst, *map(max, ratios.values()))
    return Verdict(
        word(worst < 1.25),
        "Rms error over the bound, M, D and K: " + "; ".join(words) + ".",
        tables[THREE].runs,
    )


def old_over_best(tables: Tables) -> Verdict:
    table = tables[THREE]
    ratio = {h: error(table, OLD, h, "M") / error(table, BEST, h, "M") for h in (0.01, 0.02, 0.0625)}
    words = ", ".join(f"{number(r)} at h = {h}" for h, r in ratio.items())
    return Verdict(word(ratio[0.01] > 20 and ratio[0.02] > 5), f"3x3, M: {words}.", table.runs)


def new_over_best(tables: Tables) -> Verdict:
    table = tables[THREE]
    wide, near = (error(table, NEW, h, "M") / error(table, BEST, h, "M") for h in (0.25, 0.02))
    far = error(table, EXACT_START, 0.005, "M") / error(table, BEST, 0.005, "M")
    numbers = f"3x3, M: {number(wide)} times at h = 0.25, {number(near, 3)} at h = 0.02; from the exact start {number(far, 3)} at h = 0.005."
    return Verdict(word(wide > 5 and near < 1.15), numbers, table.runs)


CLAIMS = (
    Claim("Maximum likelihood with the spline hold, started from the data alone, is on the bound at every sampling time.", "Figs 5.2-5.9", (THREE, EIGHT), on_the_bound),
    Claim("The blow-up of n4sid + d2c is not in the records.", "Figs 5.2-5.5", (THREE,), old_over_best),
    Claim("The variational method is as good where its rule is accurate and its start holds, and only there.", "Figs 5.2-5.5", (THREE,), new_over_best),
)  # fmt: skip
