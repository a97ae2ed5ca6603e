"""effects that these records do not tell apart, excitations -> the one that would.

T-optimality (Atkinson & Fedorov 1975): the excitation on which the chosen model, simulated, stays farthest from its
rival after the rival has moved its parameters as far as the training records let it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid_bench.gap.answer import Answer
from sysid_bench.gap.colour import Floor
from sysid_bench.gap.descent import Fit
from sysid_bench.gap.free_run import run, shown
from sysid_bench.gap.price import Contender
from sysid_bench.gap.problem import Point, Problem, evaluate
from sysid_bench.gap.traces import Trace, banded
from sysid_bench.nouns import Array, Excitation, Signal

MOST_SAMPLES = 4000
MOST_RIVALS = 3
SETTLED = 30.0  # squared difference over the noise from which a name wins: as in a screen


@dataclass(frozen=True)
class Settling:
    """config: the excitation's node; difference: squared, over the noise variance, of the closest pair; seconds."""

    config: Mapping[str, Any]
    difference: float
    seconds: float
    between: tuple[str, ...]

    @property
    def settles(self) -> bool:
        return self.difference > SETTLED


def settling(
    answer: Answer, classes: list[list[Contender]], candidates: Sequence[tuple[Mapping[str, Any], Excitation]]
) -> Settling | None:
    """The candidate that tells each class's first member best from its others; None where nothing is left to settle.

    classes: the chosen contender, then what it was not told apart from; candidates: (config node, excitation).
    """
    if not classes or answer.problem.on_force:
        return None
    problem, pairs = answer.problem, [(c[0], other) for c in classes for other in c[1 : 1 + MOST_RIVALS]]
    trace = problem.traces[0]
    N, best = min(trace.N, MOST_SAMPLES), None
    names = tuple(dict.fromkeys(c.effect.name for pair in pairs for c in pair))
    for node, excitation in candidates:
        signal = excitation.signal(N, trace.h, problem.model.nu, np.random.default_rng(1))
        values = [difference(problem, one.fit, other.fit, signal) for one, other in pairs]
        worst = min((v for v in values if v is not None), default=0.0)
        if best is None or worst > best.difference:
            best = Settling(node, worst, N * trace.h, names)
    return best


def difference(problem: Problem, one: Fit, other: Fit, signal: Signal) -> float | None:
    """Squared whitened distance of one's free run from other's best; None where either leaves every bound."""
    trace = _simulated(problem, one, signal)
    if trace is None:
        return None
    here = problem.on((trace,))
    point = Point(other.point.theta, other.point.effects, (np.zeros(2 * problem.model.n),))
    found = evaluate(here, point)
    if found is None:
        return None
    rows, runs = found
    J = here.jacobian(point, runs, other.parameters)[:, : len(point.theta) + len(other.parameters)]
    known = _known(problem, other)
    g = J.T @ rows
    step = np.linalg.lstsq(J.T @ J + known, g, rcond=1e-12)[0]
    return float(max(rows @ rows - g @ step, 0.0))


def _simulated(problem: Problem, one: Fit, signal: Signal) -> Trace | None:
    """What the fitted model would show from rest, in the band of the training records."""
    old, model = problem.traces[0], problem.model_at(one.point)
    N = len(signal.u)
    empty = Trace(
        signal.u,
        np.zeros((N, old.y.shape[1])),
        old.h,
        0.0,
        np.ones(N, dtype=bool),
        signal.hold,
        signal.period,
    )
    y = shown(problem, empty, run(problem, empty, model, np.zeros(2 * problem.model.n)))
    if not np.isfinite(y).all():
        return None
    whole = Trace(signal.u, y, old.h, 0.0, empty.good, signal.hold, signal.period)
    floor = Floor(old.variance, np.zeros(len(old.variance)))
    return banded(whole, floor, float(old.omega[-1]))


def _known(problem: Problem, fit: Fit) -> Array:
    """What the training records say of theta and the parameters: the inverse of their covariance; the prior without."""
    size, nt = len(fit.point.theta) + len(fit.parameters), len(fit.point.theta)
    if fit.covariance is not None:
        return np.linalg.pinv(fit.covariance[:size, :size], rcond=1e-12)
    out = np.zeros((size, size))
    out[np.arange(nt), np.arange(nt)] = problem.prior**-2
    return out


def proposals(answer: Answer) -> list[dict[str, Any]]:
    """Excitations worth trying, as knobs of the options: half, once and twice the force of the records, three bands.

    Each is {"option": name, knob: value, ...}.
    """
    trace = answer.problem.traces[0]
    rms = float(np.sqrt(np.mean(trace.u**2)))
    low, high = (w / (2 * np.pi) for w in _band(answer))
    top = 0.45 / trace.h
    found: list[dict[str, Any]] = []
    for level in (0.5, 1.0, 2.0):
        for f_min, f_max in ((0.3 * low, 1.6 * high), (0.1 * low, low), (high, 4 * high)):
            band = {"f_min_hz": _rounded(f_min), "f_max_hz": _rounded(min(f_max, top))}
            found.append({"option": "multisine", **band, "rms_N": _rounded(level * rms)})
        clock = max(1, round(1 / (3 * high * trace.h)))
        found.append({"option": "prbs", "clock_samples": clock, "amplitude_N": _rounded(level * rms)})
    dwell = _rounded(max(2 / low, 4 * trace.h))
    found.append({"option": "steps", "dwell_s": dwell, "amplitude_N": _rounded(2 * rms)})
    return found


def _band(answer: Answer) -> tuple[float, float]:
    from sysid_bench.gap.problem import frequency_range

    return frequency_range(answer.problem.model, answer.problem.traces[0])


def _rounded(x: float) -> float:
    return float(f"{x:.3g}")
