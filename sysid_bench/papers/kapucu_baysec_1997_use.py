"""tables -> verdicts on what Kapucu and Baysec (1997) say the difference equation is good for."""

from __future__ import annotations

import numpy as np

from sysid_bench.papers.claims import Claim, Verdict, number, percent, word
from sysid_bench.papers.evidence import Table, Tables
from sysid_bench.papers.kapucu_baysec_1997 import CRITICAL, DAMPINGS, OVER, UNDER, deviation

DAMPED = (UNDER, CRITICAL, OVER)


def lumped_recoverable(tables: Tables) -> Verdict:
    table = tables["fig2_5"]
    limit, words, within = 0.05, [], 0
    for plant in DAMPED:
        good = [T for T in table.points("sampling.h_s") if _worst_parameter(table, plant, T) < limit]
        span = f"T = {number(good[0])} .. {number(good[-1])}" if good else "nowhere"
        within += bool(good)
        words.append(f"c = {DAMPINGS[plant]:g}: {span}")
    early, late = (_worst_parameter(table, UNDER, T) for T in (0.1, 3.6))
    numbers = (
        f"m, c and k all within 5 % (medians): {'; '.join(words)}. Outside: c = 1 has {percent(early)} at T = 0.1 "
        f"and {percent(late)} at T = 3.6."
    )
    return Verdict(word(within == 3 and max(early, late) < limit, within > 0), numbers, table.runs)


def _worst_parameter(table: Table, plant: str, T: float) -> float:
    at = table.at(plant=plant, sampling__h_s=T)
    return max(at.median(f"{X}_error") for X in "MDK")


def small_interval_is_best(tables: Tables) -> Verdict:
    table = tables["fig2_5"]
    words = [
        f"c = {DAMPINGS[p]:g}: {percent(_worst_parameter(table, p, 0.1))} at T = 0.1 against "
        f"{percent(_worst_parameter(table, p, 1.0))} at T = 1"
        for p in DAMPED
    ]
    better = [_worst_parameter(table, p, 0.1) < _worst_parameter(table, p, 1.0) for p in DAMPED]
    fall = tables["fall"]
    bias = [fall.at(sampling__h_s=0.5, noise__snr_db=snr).median("a2") for snr in (27.0, 13.0)]
    numbers = (
        f"Worst of m, c, k: {'; '.join(words)}. Noise in the regressors biases least squares: a2 at T = 0.5, exact .607, is "
        f"{number(bias[0], 3)} with 10 mV and {number(bias[1], 3)} with 50 mV."
    )  # fmt: skip
    return Verdict(word(all(better), any(better)), numbers, table.runs)


def short_interval_response(tables: Tables) -> Verdict:
    table = tables["response"].at(analysis__order=2)
    pairs = [[table.at(plant=p, sampling__h_s=T).median("simulation") for T in (0.1, 1.0)] for p in DAMPED]
    words = "; ".join(f"c = {DAMPINGS[p]:g}: {percent(a)}, {percent(b)}" for p, (a, b) in zip(DAMPED, pairs))
    numbers = f"Free-run error under a fresh force at T = 0.1 and at T = 1, 12 bits: {words}."
    return Verdict(word(all(a < b for a, b in pairs), any(a < b for a, b in pairs)), numbers, table.runs)


def second_order_suffices(tables: Tables) -> Verdict:
    table = tables["response"]
    middle = [T for T in table.points("sampling.h_s") if 0.5 <= T <= 3]
    gain = [_order_gain(table, p, T) for p in DAMPED for T in middle]
    early = [_order_gain(table, p, T) for p in DAMPED for T in (0.1, 0.2)]
    size = table.at(plant=UNDER, sampling__h_s=0.5, analysis__order=3).median("higher_terms")
    numbers = (
        f"Free-run error of order 2 over that of order 3: {number(min(gain))} .. {number(max(gain))} for T = 0.5 .. 3, "
        f"{number(min(early))} .. {number(max(early))} at T = 0.1 and 0.2, where order 3 takes up the converter's noise. The terms are not small "
        f"({number(size)} at T = 0.5, c = 1): they form a common factor of numerator and denominator."
    )  # fmt: skip
    return Verdict(word(max(gain + early) < 1.5, max(gain) < 2), numbers, table.runs)


def _order_gain(table: Table, plant: str, T: float) -> float:
    at = table.at(plant=plant, sampling__h_s=T)
    return at.at(analysis__order=2).median("simulation") / at.at(analysis__order=3).median("simulation")


def response_is_near(tables: Tables) -> Verdict:
    table = tables["response"].at(analysis__order=2)
    T, errors = table.curve("simulation")
    by_T = ", ".join(
        f"{percent(e)} at T = {number(t)}" for t, e in zip(T, errors) if t in (0.1, 0.2, 0.5, 1.0, 3.0)
    )
    numbers = f"Free-run error under a fresh force, median over c = 1, 2, 4: {by_T}."
    return Verdict(word(errors.max() < 0.02, np.min(errors) < 0.02), numbers, table.runs)


def sines_up_to_resonance(tables: Tables) -> Verdict:
    table = tables["response"].at(analysis__order=2)
    held = {T: table.at(sampling__h_s=T).median("sine") for T in (0.1, 0.5, 1.0, 3.0)}
    smooth = {T: table.at(sampling__h_s=T).median("sine_smooth") for T in (0.1, 0.5, 1.0)}
    numbers = (
        "Largest error of the response up to omega_n, sines put out through the same hold: "
        + ", ".join(f"{percent(e)} at T = {number(T)}" for T, e in held.items())
        + ". Smooth sines see the hold's delay of T/2: "
        + ", ".join(f"{percent(e)} at T = {number(T)}" for T, e in smooth.items())
        + "."
    )
    good = [T for T, e in held.items() if e < 0.05]
    return Verdict(word(len(good) == len(held), bool(good)), numbers, table.runs)


def longer_is_better(tables: Tables) -> Verdict:
    table = tables["record_length"]
    spread = {
        T: [_spread(table.at(sampling__h_s=T, sampling__N=N), "a1") for N in (44, 704)] for T in (0.2, 1.0)
    }
    bias = [deviation(table.at(sampling__h_s=0.2, sampling__N=N), "a1") for N in (44, 704)]
    words = "; ".join(f"T = {T}: {number(a)} to {number(b)}" for T, (a, b) in spread.items())
    numbers = (
        f"Width of the 10 % to 90 % range of a1 from 44 to 704 samples: {words}. The bias does not go with it: at T = 0.2 the median is "
        f"off by {number(bias[0])} and {number(bias[1])}."
    )  # fmt: skip
    narrower = all(b < a / 2 for a, b in spread.values())
    return Verdict(word(narrower and bias[1] < bias[0] / 2, narrower), numbers, table.runs)


def _spread(table: Table, name: str) -> float:
    low, high = np.quantile(table.values(name), [0.1, 0.9])
    return float(high - low)


CLAIMS = (
    Claim("m, c and k can be extracted from the measured coefficients.", "conclusion 3", ("fig2_5",), lumped_recoverable),
    Claim("T should be as small as possible.", "section 2 (after Mehra and Lainiotis)", ("fig2_5", "fall"), small_interval_is_best),
    Claim("Coefficients of shorter sampling times model a response that fits better.", "section 2 (after Cadzow)", ("response",), short_interval_response),
    Claim("Order 2 represents the system well; terms of higher order are negligible.", "conclusion 1", ("response",), second_order_suffices),
    Claim("The response of the discrete model is very proximate to the real one.", "conclusion 2", ("response",), response_is_near),
    Claim("Sinusoidal excitations show a good fit up to the natural frequency.", "conclusion 3", ("response",), sines_up_to_resonance),
    Claim("As N increases, the coefficient values become more reliable.", "section 3", ("record_length",), longer_is_better),
)  # fmt: skip
