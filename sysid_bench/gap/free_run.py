"""point -> free runs of its model on the traces, their whitened residual rows, and the exact derivatives of those."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sysid_bench.gap.sensitivity import derivatives, variables
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
    quick = problem.quick or trace.pull is not None  # only on the way: one step per sample will do
    effects = as_effects(model.effects)
    substeps = 1 if quick else problem.fineness * substeps_for(effects, model.n)
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
    n, nt, blocks = problem.model.n, len(problem.entries), []
    starts = 2 * n
    for k, (trace, one) in enumerate(zip(problem.traces, runs)):
        J = _trace_jacobian(problem, point, trace, one, parameters, point.starts[k])
        block = np.zeros((len(J), nt + len(parameters) + starts * len(runs)))
        block[:, : nt + len(parameters)] = J[:, : nt + len(parameters)]
        at = nt + len(parameters) + k * starts
        block[:, at : at + starts] = J[:, nt + len(parameters) :]
        blocks.append(block)
    return np.concatenate(blocks)


def _trace_jacobian(problem: Problem, point: Point, trace: Trace, one: Trajectory, parameters, x0) -> Array:
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
    keep = keep_rows(problem, A)
    d = derivatives(one, wanted, keep)
    sensed = np.ones((trace.N, A.C.shape[0], 1))
    for effect in A.sensors:
        if effect.name == "sensor_scale":
            sensed[:, sensor_channels(effect, A)] *= effect.value("factor")
        if effect.name == "sensor_clipping":
            ch = sensor_channels(effect, A)
            sensed[:, ch] *= (np.abs(shown(problem, trace, one)[:, ch]) < effect.value("limit"))[:, :, None]
    D = trace.spectrum(d * sensed)
    if problem.model.output == "acceleration":
        D = D * (1j * trace.omega)[:, None, None]
    columns = np.empty((trace.F, D.shape[1], nt + len(parameters) + 2 * n), dtype=complex)
    columns[:, :, :nt] = D[:, :, :nt] * problem.scale
    columns[:, :, nt + len(parameters) :] = D[:, :, len(wanted) - 2 * n :]
    at_extra, at_inner = nt, nt + len(extra)
    for k, (e, p) in enumerate(parameters):
        effect = point.effects[e]
        if effect.path == "force":
            columns[:, :, nt + k] = D[:, :, at_inner]
            at_inner += 1
        elif effect.path == "structure":
            total = 0
            for _, factor in chain[e, p]:
                total = total + factor * D[:, :, at_extra]
                at_extra += 1
            columns[:, :, nt + k] = total
        else:
            columns[:, :, nt + k] = _by_difference(problem, point, trace, one, e, p, x0)
    return trace.rows(columns)


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
