"""records, model, checked data -> the problem on its band and noise floor, faults of the data as effects of the sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid_bench.effects import effect_class
from sysid_bench.gap.check_data import DataCheck
from sysid_bench.gap.colour import Floor, mean_floor
from sysid_bench.gap.descent import Fit
from sysid_bench.gap.force import drowned, floats, on_force, with_offset
from sysid_bench.gap.free_run import run, shown
from sysid_bench.gap.inverse import ForceProblem
from sysid_bench.gap.problem import Problem, evaluate, frequency_range, problem_of
from sysid_bench.gap.refit import linear_fit
from sysid_bench.gap.traces import band_end, banded, noise_floor, trace_of
from sysid_bench.mechanics.effect import Effect
from sysid_bench.nouns import Array, Model, Record

STEPS = 1.3  # times the variance of rounding to a channel's steps, which rounding of a slow motion may reach
LOWER = 0.85  # of the noise floor: from which what a fit leaves shows a lower one


def prepared(records: list[Record], model: Model, check: DataCheck) -> tuple[Problem, float, str]:
    """The problem, its noise floor and band set; how far the nominal is from the floor; how that was found."""
    traces = []
    for record, bad in zip(records, check.bad):
        flagged = replace(
            record,
            quality=np.where(
                bad, np.maximum(record.quality if record.quality is not None else 0, 1), 0
            ).astype(np.uint8),
        )
        traces.append(trace_of(flagged, model))
    traces = tuple(traces)
    problem = problem_of(model, traces)
    if floats(model):
        forces, how = on_force(problem_of(with_offset(model), traces), check.lattice)
        if not drowned(forces, how):
            return forces, nominal_rho_of(forces), how
    omega = max(frequency_range(model, t)[1] for t in traces)
    noise = _floor(problem, check.lattice, omega)
    end = max(band_end(t, noise, omega) for t in traces)
    traces = tuple(banded(t, noise, end) for t in traces)
    problem, how = problem.on(traces), "from the highest frequencies"
    return problem, nominal_rho_of(problem), how


def with_faults(model: Model, check: DataCheck) -> tuple[Model, tuple[Effect, ...]]:
    """The model with the faults of the data as effects of its sensors, and these effects."""
    made = []
    for fault in check.faults:
        dof = None
        if fault.channel is not None:
            dof = int(np.argmax(np.abs(model.output_map[fault.channel])))
        made.append(effect_class(fault.name)(dof=dof, **fault.parameters))
    shown = [e for e in made if e.name == "sensor_clipping"]  # the others change no prediction worth having
    rest = [e for e in made if e.name != "sensor_clipping"]
    return replace(model, effects=(*model.effects, *shown)), tuple(shown + rest)


def nominal_rho_of(problem: Problem) -> float:
    found = evaluate(problem, problem.nominal())
    return float(found[0] @ found[0] / len(found[0])) if found is not None else np.inf


def _floor(problem: Problem, lattice: Array, omega: float) -> Floor:
    """Noise over all traces: per channel the smaller of what the nominal leaves and what y itself shows on high."""
    point = problem.nominal()
    model = problem.model_at(point)
    parts = []
    for trace, x0 in zip(problem.traces, point.starts):
        own = noise_floor(trace, trace.y, lattice, omega)
        y = shown(problem, trace, run(problem, trace, model, x0))
        parts.append(
            own.smaller(noise_floor(trace, trace.y - y, lattice, omega)) if np.isfinite(y).all() else own
        )
    return mean_floor(parts)


def on_a_lower_floor(problem: Problem, linear: Fit, check: DataCheck) -> tuple[Problem, Fit]:
    """The problem and its refit, on the floor that the refit shows where that is lower."""
    lower = lower_floor(problem, linear, check)
    again = linear_fit(lower) if lower is not None else None
    return (problem, linear) if lower is None or again is None else (lower, again)


def lower_floor(problem: Problem, fit: Fit, check: DataCheck) -> Problem | None:
    """The problem on the noise floor of what a fit leaves; None where that is much the same.

    Few samples per period, or hard contacts, and the motion itself still fills the highest frequencies of a record.
    """
    if isinstance(problem, ForceProblem):
        return None
    omega = max(frequency_range(problem.model, t)[1] for t in problem.traces)
    left = [t.y - shown(problem, t, one) for t, one in zip(problem.traces, fit.runs)]
    found = mean_floor([noise_floor(t, r, check.lattice, omega) for t, r in zip(problem.traces, left)])
    present = np.mean([t.variance for t in problem.traces], axis=0)
    if np.all(found.variance > LOWER * present):
        return None
    floor = Floor(np.minimum(found.variance, present), found.phi)
    end = max(band_end(t, floor, omega) for t in problem.traces)
    return problem.on(tuple(banded(t, floor, end) for t in problem.traces))


def within_steps(problem: Problem, fit: Fit, lattice: Array) -> bool:
    """True where what a fit leaves is no more than the noise and the rounding to the steps lattice (ny,) of the channels.

    The rounding of a slow motion lies where the motion does, far above the floor of the highest frequencies.
    """
    left = np.mean(
        [np.var(t.y - shown(problem, t, one), axis=0) for t, one in zip(problem.traces, fit.runs)], axis=0
    )
    noise = np.mean([t.variance for t in problem.traces], axis=0)
    return bool(np.all(left <= noise + STEPS * lattice**2 / 12) and np.any(lattice > 0))
