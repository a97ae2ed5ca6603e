"""point -> free runs of its model on the traces, their whitened residual rows, and the exact derivatives of those."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sysid_bench.gap.sensitivity import Variables, derivatives, variables
from sysid_bench.gap.traces import Trace
from sysid_bench.mechanics.assembly import Assembly, assemble, measured, sensor_channels
from sysid_bench.mechanics.effect import Effect, as_effects
from sysid_bench.mechanics.trajectory import Trajectory, trajectory
from sysid_bench.nouns import Array, Model

if TYPE_CHECKING:
    from sysid_bench.gap.problem import Point, Problem

SMOOTH = frozenset(
    "quadratic_drag cubic_stiffness quadratic_stiffness constant_force position_ripple periodic_disturbance "
    "time_varying_stiffness structural_damping".split()
)


def substeps_for(effects: tuple[Effect, ...], n: int) -> int:
    """Small steps per sample: more where a law has corners."""
    if any(e.path == "force" and e.name not in SMOOTH for e in effects):
        return 3 if n < 6 else 2
    if any(e.path in ("force", "actuator") for e in effects):
        return 2
    return 1


def hold_of(effects: tuple[Effect, ...], trace: Trace) -> str:
    return next((getattr(e, "hold", trace.hold) for e in effects if e.name == "wrong_hold"), trace.hold)


def run(problem: Problem, trace: Trace, model: Model, x0: Array) -> Trajectory:
    """Free run of one model on one trace."""
    effects = as_effects(model.effects)
    substeps = 1 if problem.quick else problem.fineness * substeps_for(effects, model.n)
    stages = trace.stages(substeps, hold_of(effects, trace))
    return trajectory(assemble(model), stages, trace.h, substeps, x0, trace.t0, trace.pulls(substeps))


def shown(problem: Problem, trace: Trace, run: Trajectory) -> Array:
    """(N, ny) what the sensors would have shown."""
    q, v, a = moved(problem, run)
    return measured(run.assembly, problem.model.output, q, v, a, trace.t)


def moved(problem: Problem, run: Trajectory) -> tuple[Array, Array, Array]:
    """q, v, a at the samples; a only where it is what is measured."""
    return run.motion() if problem.model.output == "acceleration" else _states(run)


def _states(run: Trajectory) -> tuple[Array, Array, Array]:
    n, X = run.assembly.n, run.X[:: run.substeps]
    return X[:, :n], X[:, n:], X[:, n:]


def free_run(problem: Problem, point: Point) -> tuple[Array, tuple[Trajectory, ...]] | None:
    model = problem.at(point.theta, point.effects)
    if model is None:
        return None
    rows, runs = [], []
    for trace, x0 in zip(problem.traces, point.starts):
        one = run(problem, trace, model, x0)
        y = shown(problem, trace, one)
        if not np.isfinite(y).all() or np.abs(y).max() > 1e3 * np.abs(trace.y).max():
            return None
        rows.append(trace.rows(trace.spectrum(trace.filled(trace.y - y))))
        runs.append(one)
    return np.concatenate(rows), tuple(runs)


def keep_rows(problem: Problem, assembly: Assembly) -> Array:
    """(ny, 2 n) what is kept of the state: C q, or C v where velocity or acceleration is measured."""
    zero = np.zeros_like(assembly.C)
    position = problem.model.output == "displacement"
    return np.hstack([assembly.C, zero] if position else [zero, assembly.C])


def free_run_jacobian(problem: Problem, point: Point, runs, parameters) -> Array:
    first, starts = len(problem.entries) + len(parameters), 2 * problem.model.n
    J, at = np.zeros((problem.rows, first + starts * len(runs))), 0
    for k, (trace, one) in enumerate(zip(problem.traces, runs)):
        rows = slice(at, at + 2 * trace.F * trace.y.shape[1])
        begin = slice(first + k * starts, first + (k + 1) * starts)
        _fill(J[rows, :first], J[rows, begin], problem, point, trace, one, parameters, point.starts[k])
        at = rows.stop
    return J


def _fill(
    out: Array, of_start: Array, problem: Problem, point: Point, trace: Trace, one: Trajectory, parameters, x0
) -> None:
    """The rows of one trace: those of theta and the parameters into out, those of its start into of_start."""
    A, n, nt = one.assembly, problem.model.n, len(problem.entries)
    laws = [e for e in point.effects if e.path == "force"]
    offset = np.cumsum([0, *(len(e.values) for e in laws)])
    inner = [
        int(offset[laws.index(point.effects[e])]) + p
        for e, p in parameters
        if point.effects[e].path == "force"
    ]
    chain = {
        (e, p): _structure_chain(problem, point, e, p)
        for e, p in parameters
        if point.effects[e].path == "structure"
    }
    extra = [entry for entries in chain.values() for entry, _ in entries]
    states = [i if i < n else A.n + i - n for i in range(2 * n)]
    wanted = variables([*problem.entries, *extra], inner, states)
    rows = _derivative_rows(problem, trace, one, wanted)
    out[:, :nt] = rows[:, :nt] * problem.scale
    of_start[:] = rows[:, len(wanted) - 2 * n :]
    at_extra, at_inner = nt, nt + len(extra)
    for k, (e, p) in enumerate(parameters):
        effect = point.effects[e]
        if effect.path == "force":
            out[:, nt + k] = rows[:, at_inner]
            at_inner += 1
        elif effect.path == "structure":
            for _, factor in chain[e, p]:
                out[:, nt + k] += factor * rows[:, at_extra]
                at_extra += 1
        else:
            out[:, nt + k] = trace.rows(_by_difference(problem, point, trace, one, e, p, x0))


def _derivative_rows(problem: Problem, trace: Trace, one: Trajectory, wanted: Variables) -> Array:
    """(2 F ny, P) whitened rows of the derivative of what the sensors show with respect to each wanted variable."""
    A = one.assembly
    d = derivatives(one, wanted, keep_rows(problem, A))
    for effect in A.sensors:
        channels = sensor_channels(effect, A)
        if effect.name == "sensor_scale":
            d[channels] *= effect.value("factor")
        if effect.name == "sensor_clipping":
            d[channels] *= (np.abs(shown(problem, trace, one)[:, channels]) < effect.value("limit")).T[
                :, None
            ]
    weight = (
        trace.weight if problem.model.output != "acceleration" else trace.weight * 1j * trace.omega[:, None]
    )
    rows = np.empty((2, trace.F, len(d), len(wanted)))
    for k, channel in enumerate(d):  # one after the other: what is transformed stays near
        W = np.fft.rfft(channel)[:, : trace.F] * weight[:, k]
        rows[0, :, k], rows[1, :, k] = W.real.T, W.imag.T
    return rows.reshape(-1, len(wanted))


def _structure_chain(
    problem: Problem, point: Point, e: int, p: int
) -> list[tuple[tuple[int, int, int], float]]:
    """Entries of the augmented M, D, K that a parameter of effect e moves, and how fast."""
    effect = point.effects[e]
    values = effect.values
    step = 1e-4 * max(abs(values[p]), 1e-6)
    both = []
    for sign in (1, -1):
        moved = effect.with_values(values + sign * step * np.eye(len(values))[p])
        effects = tuple(moved if k == e else x for k, x in enumerate(point.effects))
        A = assemble(problem.model_at(replace(point, effects=effects)))
        both.append((A.M, A.D, A.K))
    chain = []
    for m in range(3):
        slope = (both[0][m] - both[1][m]) / (2 * step)
        rows, cols = np.nonzero(np.triu(slope))
        chain += [((m, int(i), int(j)), float(slope[i, j])) for i, j in zip(rows, cols)]
    return chain


def _by_difference(problem: Problem, point: Point, trace: Trace, one: Trajectory, e: int, p: int, x0: Array):
    """(F, ny) derivative by a parameter of the actuator or sensor path: one more simulation, one-sided."""
    effect = point.effects[e]
    values = effect.values
    step = 1e-3 * max(abs(values[p]), _smallest(effect, trace))
    moved = effect.with_values(values + step * np.eye(len(values))[p])
    effects = tuple(moved if k == e else x for k, x in enumerate(point.effects))
    other = problem.model_at(replace(point, effects=effects))
    again = run(problem, trace, other, x0) if effect.path == "actuator" else replace_assembly(one, other)
    return trace.spectrum(shown(problem, trace, again) - shown(problem, trace, one)) / step


def replace_assembly(one: Trajectory, model: Model) -> Trajectory:
    return replace(one, assembly=assemble(model))


def _smallest(effect: Effect, trace: Trace) -> float:
    if effect.path == "sensor":
        return 1e-2 * float(np.std(trace.y))
    return 0.1 * trace.h if effect.name in ("input_delay", "actuator_lag") else 1e-3 * float(np.std(trace.u))
