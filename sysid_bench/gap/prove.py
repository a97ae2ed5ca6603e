"""better model, test records -> its free run there: the proof. Nothing here chooses anything."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sysid_bench.gap.descent import fit
from sysid_bench.gap.free_run import run, shown
from sysid_bench.gap.problem import Point, Problem, evaluate
from sysid_bench.gap.traces import Trace, banded, noise_floor, trace_of
from sysid_bench.mechanics.effect import as_effects, direction
from sysid_bench.nouns import Array, Model, Record

FIRST_PART = 0.25  # of a record, on which what is its own (start, phases) is fitted
PHASES = frozenset({"phase"})


@dataclass(frozen=True, eq=False)
class Proof:
    """Free run on one record: y (N, ny) predicted; gap, the share of the measured rms that it misses (see free_run_gap)."""

    record: Record
    trace: Trace
    predicted: Array
    gap: float

    def noise(self, lattice: Array, omega_max: float) -> Array:
        """(ny,) variance of the noise: the smaller of what the record shows itself and of what the run leaves; see noise_floor."""
        heard = (self.trace.y, self.trace.y - self.predicted)
        found = [
            noise_floor(self.trace, x, lattice, omega_max).variance for x in heard if np.isfinite(x).all()
        ]
        return np.min(found, axis=0)


def free_run_gap(y: Array, predicted: Array, good: np.ndarray) -> float:
    """sqrt of the mean over channels of mean((y - yhat)^2) / mean(y^2)."""
    y, predicted = y[good], predicted[good]
    power = np.maximum(np.mean(y**2, axis=0), 1e-300)
    return float(np.sqrt(np.mean(np.mean((y - predicted) ** 2, axis=0) / power)))


def prove(model: Model, record: Record, phases: frozenset[str] = PHASES, fineness: int = 1) -> Proof:
    """Free run of a model on a record; its start and its own phases are fitted on the record's first quarter.

    fineness: times the usual number of steps between samples
    """
    trace = trace_of(record, model)
    problem = Problem(model, (trace,), (), np.zeros(0), fineness=fineness)
    point = _own_start(problem, trace, phases)
    found = evaluate_free(problem, trace, point)
    return Proof(record, trace, found, free_run_gap(trace.y, found, trace.good))


def evaluate_free(problem: Problem, trace: Trace, point: Point) -> Array:
    model = replace(problem.model, effects=point.effects)
    return shown(problem, trace, run(problem, trace, model, point.starts[0]))


def _own_start(problem: Problem, trace: Trace, own: frozenset[str]) -> Point:
    """Rest, the static equilibrium, or a fitted start and fitted phases: what serves the first part best."""
    model = problem.model
    n, rest = model.n, problem.nominal()
    part = _first_part(trace)
    points = [rest, replace(rest, starts=(_static(model),))]
    phases = tuple(
        (e, p)
        for e, x in enumerate(rest.effects)
        for p, key in enumerate(x.numeric)
        if key in own and x.path == "force"
    )
    here = problem.on((part,))
    scores = [_misfit(here, part, p) for p in points]
    best = points[int(np.argmin(scores))]
    if model.initial_state == "free" or phases:
        starts = [best] + [_turned(best, phases, a) for a in (np.pi / 2, np.pi, -np.pi / 2) if phases]
        for start in starts:
            found = fit(here, start, phases, iterations=8)
            if found is not None:
                points.append(found.point)
                scores.append(_misfit(here, part, found.point))
        if model.initial_state != "free" and phases:  # the phase is the record's own, the start is not
            points += [replace(p, starts=(s,)) for p in points[2:] for s in (np.zeros(2 * n), _static(model))]
            scores = [_misfit(here, part, p) for p in points]
    return points[int(np.argmin(scores))]


def _turned(point: Point, phases, angle: float) -> Point:
    effects = list(point.effects)
    for e, p in phases:
        values = np.array(effects[e].values)
        values[p] += angle
        effects[e] = effects[e].with_values(values)
    return replace(point, effects=tuple(effects))


def _misfit(problem: Problem, part: Trace, point: Point) -> float:
    found = evaluate(problem, point)
    return np.inf if found is None else float(found[0] @ found[0])


def _first_part(trace: Trace) -> Trace:
    N = max(int(FIRST_PART * trace.N), min(trace.N, 200))
    part = Trace(trace.u[:N], trace.y[:N], trace.h, trace.t0, trace.good[:N], trace.hold, trace.period)
    found = noise_floor(part, part.y, np.zeros(part.y.shape[1]))
    floor = replace(found, variance=np.maximum(found.variance, 1e-12 * np.mean(part.y**2, axis=0)))
    return banded(part, floor, np.pi / part.h)


def _static(model: Model) -> Array:
    """(2 n,) at rest where constant forces hold it."""
    n, force = model.n, np.zeros(model.n)
    for effect in as_effects(model.effects):
        if effect.name == "constant_force":
            force += effect.value("force") * direction(effect.dof, n)
    q = np.linalg.lstsq(model.matrices[2], force, rcond=1e-9)[0]
    return np.concatenate([q, np.zeros(n)])
