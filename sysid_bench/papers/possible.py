"""tables -> what the same records hold: the methods of the thesis beside maximum likelihood with the right hold."""

from __future__ import annotations

import numpy as np

from sysid_bench.papers.bruschetta_2011 import EIGHT, EXACT_START, MDK, NEW, OLD, THREE, error
from sysid_bench.papers.claims import Claim, Verdict, number, word
from sysid_bench.papers.evidence import Table, Tables

BEST, GAUSS = "spline_ml", "variational_gauss2"


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


def linear_only(tables: Tables) -> Verdict:
    """Limit: the acceptance figure of 20 runs, 2.5."""
    table = tables[THREE].at(method="n4sid_frf")
    ratios = {
        h: max(rms_over_bound(table.at(sampling__h_s=h), X) for X in MDK)
        for h in (0.25, 0.125, 0.0625, 0.04, 0.02, 0.01)
    }
    words = ", ".join(f"{number(r)} at h = {h}" for h, r in ratios.items())
    old = max(rms_over_bound(tables[THREE].at(method=OLD, sampling__h_s=0.01), X) for X in MDK)
    return Verdict(
        word(max(ratios.values()) <= 2.5, min(ratios.values()) <= 2.5),
        f"3x3, rms error over the bound, worst of M, D, K: {words} (n4sid + d2c at h = 0.01: {number(old)}).",
        table.runs,
    )


def fourth_order_rule(tables: Tables) -> Verdict:
    words, holds = [], []
    for name, h, size in ((THREE, 0.5, "3x3"), (THREE, 0.25, "3x3"), (EIGHT, 0.05, "8x8")):
        pair = [
            max(rms_over_bound(tables[name].at(method=m, sampling__h_s=h), X) for X in MDK)
            for m in (EXACT_START, GAUSS)
        ]
        words.append(f"{number(pair[0])} to {number(pair[1])} ({size}, h = {h})")
        holds.append(pair[1] < 1.5 and pair[0] > 2 * pair[1])
    numbers = f"Rms error over the bound, worst of M, D, K, midpoint to Gauss: {', '.join(words)}."
    return Verdict(word(all(holds), any(holds)), numbers, tables[THREE].runs)


CLAIMS = (
    Claim("Maximum likelihood with the spline hold, started from the data alone, is on the bound at every sampling time.", "Figs 5.2-5.9", (THREE, EIGHT), on_the_bound),
    Claim("The blow-up of n4sid + d2c is not in the records.", "Figs 5.2-5.5", (THREE,), old_over_best),
    Claim("The variational method is as good where its rule is accurate and its start holds, and only there.", "Figs 5.2-5.5", (THREE,), new_over_best),
    Claim("n4sid done fairly (decimated, free feedthrough, linear match of the frequency response) is within 2.5 times the bound.", "Figs 5.2-5.5", (THREE,), linear_only),
    Claim("A variational rule of order 4 takes the model error away up to h = Ta/2.", "chapter 6, Figs 5.2-5.9", (THREE, EIGHT), fourth_order_rule),
)  # fmt: skip
