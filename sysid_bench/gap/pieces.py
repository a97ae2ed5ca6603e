"""records -> pieces of them, each from a start of its own: what a motion that soon forgets how it began calls for.

Clearance, ripple and friction that sticks may make a motion chaotic: however well its law is known, no free run follows
it for long. Over a few periods one does. Many short runs, each from its own start, fitted together are multiple shooting
(Bock 1983; Baake et al. 1992 for chaotic motion).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid_bench.gap.descent import Fit
from sysid_bench.gap.motion import smoothed
from sysid_bench.gap.problem import Problem, evaluate, frequency_range
from sysid_bench.gap.traces import Trace
from sysid_bench.nouns import Array

MOST, LEAST = 20, 4  # pieces of a record
PERIODS = 2.5  # of the slowest mode, that a piece lasts at least
SAMPLES = 30  # per state and one, that a piece has at least
ENDS = 0.03  # of a record at either end, left out: what smooths a motion joins its end to its start
CLOSED, SHARE = 0.3, 1e-3  # rho beyond 1, and share of the linear gap, below which a story has closed it


def closes(fit: Fit, linear: Fit) -> bool:
    """True where a fit leaves next to nothing of what the refit without effects left."""
    return fit.rho - 1 < max(CLOSED, SHARE * (linear.rho - 1))


def in_pieces(problem: Problem, linear: Fit) -> Problem | None:
    """The problem on pieces of its records; None where they are too short for that."""
    found: list[Trace] = []
    for trace, run in zip(problem.traces, linear.runs):
        q, v, _ = smoothed(problem, trace, run)
        found += _pieces(problem, trace, np.hstack([q, v]))
    if len(found) < LEAST * len(problem.traces):
        return None
    return problem.on(tuple(found))


def as_wholes(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """The records that pieces were taken of, and there the run from a fit's first start; unchanged where there are none.

    What a suspect explains is read along the motion that was measured, however far a run leaves it.
    """
    firsts = _firsts(problem.traces)
    if len(firsts) == len(problem.traces):
        return problem, fit
    whole = problem.on(wholes(problem.traces))
    point = replace(fit.point, starts=tuple(fit.point.starts[k] for k in firsts))
    found = evaluate(whole, point)
    return (
        (problem, fit) if found is None else (whole, replace(fit, point=point, rows=found[0], runs=found[1]))
    )


def wholes(traces: tuple[Trace, ...]) -> tuple[Trace, ...]:
    """The traces that these are pieces of, each once; themselves where they are whole."""
    parts = (traces[k].part_of or (traces[k], 0) for k in _firsts(traces))
    return tuple(whole for whole, _ in parts)


def _firsts(traces: tuple[Trace, ...]) -> list[int]:
    """Which traces are whole or the first piece of another."""
    found, of = [], None
    for k, trace in enumerate(traces):
        if trace.part_of is None or trace.part_of[0] is not of:
            found.append(k)
        of = trace.part_of[0] if trace.part_of else None
    return found


def _pieces(problem: Problem, trace: Trace, states: Array) -> list[Trace]:
    low, n = frequency_range(problem.model, trace)[0], problem.model.n
    length = max(PERIODS * 2 * np.pi / (low * trace.h), SAMPLES * (2 * n + 1), trace.N / MOST)
    ends = int(ENDS * trace.N)
    count = int((trace.N - 2 * ends) / length)
    N = (trace.N - 2 * ends) // count if count else 0
    return [_piece(trace, first, N, states[first]) for first in range(ends, ends + count * N, max(N, 1))]


def _piece(trace: Trace, first: int, N: int, begins: Array) -> Trace:
    """N samples from `first` on, whitened as the whole is; begins (2 n,): the state there."""
    omega = 2 * np.pi * np.fft.rfftfreq(N, trace.h)
    omega = omega[: max(int(np.searchsorted(omega, trace.omega[-1])), 8)]
    weight = np.column_stack([np.interp(omega, trace.omega[1:], c[1:]) for c in trace.weight.T])
    weight *= np.sqrt(trace.N / N)
    weight[0] /= np.sqrt(2)  # the mean has no imaginary part to share its noise with
    these = slice(first, first + N)
    return replace(
        trace, u=trace.u[these], y=trace.y[these], good=trace.good[these], t0=trace.t0 + first * trace.h, period=None,
        F=len(omega), weight=weight, part_of=(trace, first), begins=begins, _stages={},
    )  # fmt: skip
