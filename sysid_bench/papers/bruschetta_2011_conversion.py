"""tables -> verdicts on sections 1.1, 3.2 and A.4 of Bruschetta (2011): conversion back to continuous time."""

from __future__ import annotations

from sysid_bench.papers.claims import Claim, Verdict, number, percent, word
from sysid_bench.papers.evidence import Table, Tables, slope

RATIO = "analysis.sampling_ratio"


def log_error_grows(tables: Tables) -> Verdict:
    table = tables["fig3_1"].at(analysis__perturbation=0.001)
    rates = [slope(table, name, RATIO, 20, 100) for name in ("A_error", "b_error", "inverse_log_norm")]
    ends = [percent(table.at(analysis__sampling_ratio=x).median("A_error")) for x in (4, 20, 100)]
    numbers = (
        f"0.1 % perturbation: error of A {', '.join(ends)} at w_s / w_B = 4, 20, 100; it grows as h to the power "
        f"{', '.join(number(-r, 3) for r in rates)} (A, B, 1/||log F||)."
    )
    return Verdict(word(max(abs(r - 1) for r in rates) < 0.1), numbers, table.runs)


def printed_grid(tables: Tables) -> Verdict:
    table = tables["fig3_1"].at(analysis__sampling_ratio=1)
    errors = [percent(table.at(analysis__perturbation=p).median("A_error")) for p in (0.001, 0.05)]
    numbers = (
        f"i = 0 is h = infinity; at i = 1 the plant is sampled below its Nyquist rate and A is {errors[0]} off with 0.1 % "
        f"perturbation and {errors[1]} with 5 %: the logarithm takes another branch."
    )  # fmt: skip
    good = table.at(analysis__perturbation=0.001).median("A_error") < 0.1
    return Verdict(word(False, good), numbers, table.runs)


def midpoint_slopes(tables: Tables) -> Verdict:
    table = tables["fig3_2"].at(analysis__perturbation=0.001)
    rates = {x: slope(table, f"{x}_error", RATIO, 20, 100) for x in "mdk"}
    ends = {
        x: [percent(table.at(analysis__sampling_ratio=r).median(f"{x}_error")) for r in (4, 20, 100)]
        for x in "mdk"
    }
    numbers = "0.1 % perturbation, w_s / w_B = 4, 20, 100: " + "; ".join(
        f"{x} {', '.join(ends[x])} (h^{number(-rates[x], 2)})" for x in "mdk"
    )
    wanted = {"m": 0, "d": 1, "k": 2}
    return Verdict(word(all(abs(rates[x] - wanted[x]) < 0.15 for x in "mdk")), numbers + ".", table.runs)


def kappa_law(tables: Tables) -> Verdict:
    table = tables["fig3_2"].at(analysis__perturbation=0.001)
    rate = slope(table, "kappa", RATIO, 20, 100)
    ratios = table.points(RATIO)
    off = {r: _printed_over_true(table, r) for r in ratios}
    worst = min(off, key=lambda ratio: off[ratio])
    at = table.at(analysis__sampling_ratio=worst)
    numbers = (
        f"kappa grows as h^{number(-rate, 3)}. (3.36) as printed agrees to {number(max(abs(x - 1) for r, x in off.items() if r > 4))} "
        f"for h < 1.2 s, but leaves out the singular value sqrt(2), the largest for 1.24 s < h < 3.24 s: at h = "
        f"{number(at.median('h_s'), 3)} s it gives {number(at.median('kappa_printed'), 3)} for {number(at.median('kappa'), 3)}."
    )  # fmt: skip
    exact = off[worst] > 1 - 1e-9
    return Verdict(word(exact and abs(rate - 2) < 0.05, abs(rate - 2) < 0.05), numbers)


def _printed_over_true(table: Table, ratio: float) -> float:
    at = table.at(analysis__sampling_ratio=ratio)
    return at.median("kappa_printed") / at.median("kappa")


def midpoint_worse(tables: Tables) -> Verdict:
    midpoint = tables["fig3_2"].at(analysis__perturbation=0.001, analysis__sampling_ratio=100)
    zoh = tables["figA_1"].at(analysis__sampling_ratio=100)
    pairs = {x: (midpoint.median(f"{x}_error"), zoh.median(f"{x}_error")) for x in "mdk"}
    words = ", ".join(f"{x} {percent(a)} / {percent(b)}" for x, (a, b) in pairs.items())
    return Verdict(
        word(pairs["k"][0] > pairs["k"][1]), f"w_s / w_B = 100, 0.1 %: midpoint / ZOH {words}.", zoh.runs
    )


def zoh_spreads_alike(tables: Tables) -> Verdict:
    table = tables["figA_1"]
    rates = {x: slope(table, f"{x}_error", RATIO, 20, 100) for x in "mdk"}
    at = table.at(analysis__sampling_ratio=100)
    sizes = ", ".join(f"{x} {percent(at.median(f'{x}_error'))}" for x in "mdk")
    numbers = (
        "All grow as 1/h: exponents "
        + ", ".join(f"{x} {number(r, 3)}" for x, r in rates.items())
        + f". Sizes at w_s / w_B = 100: {sizes} (d itself is 0.2)."
    )
    return Verdict(word(all(abs(r - 1) < 0.15 for r in rates.values())), numbers, table.runs)


def logarithm_biases(tables: Tables) -> Verdict:
    table = tables["fig3_1"].at(analysis__sampling_ratio=20)
    pairs = {
        p: [table.at(analysis__perturbation=p).median(x) for x in ("A_bias", "A_error")]
        for p in (0.001, 0.05)
    }
    words = "; ".join(
        f"{percent(p)} perturbation: {percent(b)} of {percent(e)}" for p, (b, e) in pairs.items()
    )
    bias, error = pairs[0.05]
    numbers = (
        f"w_s / w_B = 20, error of the mean A of 10 000 models against the rms error: {words}; chance alone leaves "
        f"{percent(error / 100)} in the latter case. The bias is a small part of the error."
    )  # fmt: skip
    return Verdict(word(bias > 0.3 * error, bias > 2 * error / 100), numbers, table.runs)


CLAIMS = (
    Claim("Converting by the matrix logarithm amplifies errors as 1/||log F||, without bound as h goes to zero.", "sections 1.1, 3.2.1, Fig. 3.1", ("fig3_1",), log_error_grows),
    Claim("The study of the conversion error can be made at sampling frequencies i w_B, i = 0, 1, 2, 3.", "section 3.2", ("fig3_1",), printed_grid),
    Claim("Midpoint map: the error of m is constant, of d grows as 1/h, of k as 1/h^2.", "section 3.2.2, Remark 2, Fig. 3.2", ("fig3_2",), midpoint_slopes),
    Claim("kappa(h) is (3.36), proportional to 1/h^2.", "(3.36)", ("fig3_2",), kappa_law),
    Claim("The midpoint rule's ill-conditioning may be even worse than the ZOH's.", "section 3.2.2", ("fig3_2", "figA_1"), midpoint_worse),
    Claim("With ZOH the error spreads over the three parameters in the same way.", "A.4, Fig. A.1", ("figA_1",), zoh_spreads_alike),
    Claim("The inverse ZOH is so nonlinear that it biases the continuous parameters.", "chapter 1", ("fig3_1",), logarithm_biases),
)  # fmt: skip
