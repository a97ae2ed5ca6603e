"""motion seen, linear model -> columns: what a unit of each parameter, force, sensor fault or input effect adds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid_bench.gap.free_run import moved
from sysid_bench.gap.motion import Seen as SeenMotion
from sysid_bench.gap.place_forces import force_along
from sysid_bench.gap.problem import Point, Problem
from sysid_bench.gap.traces import Trace
from sysid_bench.mechanics.assembly import actuated, effect_channels
from sysid_bench.mechanics.effect import Effect, direction
from sysid_bench.mechanics.trajectory import trajectory
from sysid_bench.nouns import Array


def theta_columns(problem: Problem, s: SeenMotion) -> np.ndarray:
    """(F, ny, ntheta) response to a unit change of each entry."""
    B = [s.trace.spectrum(x) for x in (s.a, s.v, s.q)]
    out = np.empty((s.trace.F, s.G.shape[1], len(problem.entries)), dtype=complex)
    for k, ((m, i, j), scale) in enumerate(zip(problem.entries, problem.scale)):
        column = s.G[:, :, i] * B[m][:, j, None]
        if i != j:
            column = column + s.G[:, :, j] * B[m][:, i, None]
        out[:, :, k] = -scale * column
    return out


def force_columns(s: SeenMotion, c: Array, forces: Array) -> np.ndarray:
    """(F, ny, m) response to forces (N, m) along c that the model lacks (they stand on the left-hand side)."""
    g = s.G[:, :, : len(c)] @ c
    return -g[:, :, None] * s.trace.spectrum(forces)[:, None, :]


def own_columns(problem: Problem, point: Point, s: SeenMotion) -> np.ndarray:
    """Columns of the effects that are already in the model, and of their parameters."""
    n, columns = problem.model.n, []
    for effect in point.effects:
        if effect.path == "force":
            c = direction(effect.dof, n)
            x, v = s.q @ c, s.v @ c
            f0 = force_along(effect, x, v, s.trace.h, s.trace.t0)
            forces = [f0]
            for p, key in enumerate(effect.numeric):
                if key in effect.held:
                    continue
                step = 1e-3 * max(abs(effect.values[p]), 1e-6)
                moved = effect.with_values(effect.values + step * np.eye(len(effect.values))[p])
                forces.append((force_along(moved, x, v, s.trace.h, s.trace.t0) - f0) / step)
            columns.append(force_columns(s, c, np.column_stack(forces)))
        if effect.path == "structure":
            c = direction(effect.dof, n)
            columns.append(force_columns(s, c, np.column_stack([s.q @ c, s.v @ c, s.a @ c])))
        if effect.path == "sensor":
            channel = int(np.argmax(np.abs(problem.model.output_map[:, effect.dof or 0])))
            columns.append(sensor_columns(s, effect.name, channel))
        if effect.path == "actuator" and effect.numeric:
            step = 0.02 * max(effect.values[0], 1e-9)
            columns.append(
                actuated_difference(problem, point, s, effect, effect.with_values(effect.values + step))
            )
    return (
        np.concatenate(columns, axis=2) if columns else np.zeros((s.trace.F, s.G.shape[1], 0), dtype=complex)
    )


def sensor_columns(s: SeenMotion, name: str, channel: int) -> np.ndarray:
    t = np.arange(s.trace.N) / s.trace.N
    if name == "sensor_scale":  # the linear response, not the measurement: that would explain itself away
        shapes = [_linear_output(s)[:, channel]]
    else:
        shapes = [np.ones(s.trace.N)] if name == "sensor_bias" else [t, t * t]
    out = np.zeros((s.trace.F, s.G.shape[1], len(shapes)), dtype=complex)
    out[:, channel, :] = s.trace.spectrum(np.column_stack(shapes))
    return out


def _linear_output(s: SeenMotion) -> Array:
    return s.trace.y - s.trace.signal(s.left)


def actuated_difference(
    problem: Problem, point: Point, s: SeenMotion, old: Effect | None, new: Effect
) -> np.ndarray:
    """(F, ny, 1) change of the linear model's response when one actuator effect is replaced or added."""
    run, trace = s.linear, s.trace
    small, A = trace.h / run.substeps, run.assembly
    others = replace(A, actuators=tuple(e for e in A.actuators if e is not old))
    plain = actuated(others, trace.stages(run.substeps), small)
    channels = effect_channels(new, A.L) or [0]  # one that it leaves as it is
    part = plain[:, :, channels] if len(channels) < A.L.shape[1] else plain  # the others stay as they are
    alone = replace(A, L=A.L[:, channels], actuators=())
    before = actuated(replace(alone, actuators=(old,)), part, small) if old else part
    after = actuated(replace(alone, actuators=(new,)), part, small)
    return measured_spectrum(problem, trace, trajectory(alone, after - before, trace.h, run.substeps))


def held_otherwise(problem: Problem, s: SeenMotion, hold: str) -> np.ndarray:
    run, trace = s.linear, s.trace
    substeps = max(run.substeps, 2)
    change = trace.stages(substeps, hold) - trace.stages(substeps)
    moved = trajectory(replace(run.assembly, actuators=()), change, trace.h, substeps)
    return measured_spectrum(problem, trace, moved)


def plain_response(problem: Problem, s: SeenMotion, channel: int) -> Array:
    """Rows of the linear model's response to one input channel alone."""
    stages = np.zeros_like(s.trace.stages(s.linear.substeps))
    stages[:, :, channel] = s.trace.stages(s.linear.substeps)[:, :, channel]
    run = trajectory(replace(s.linear.assembly, actuators=()), stages, s.trace.h, s.linear.substeps)
    return s.trace.rows(measured_spectrum(problem, s.trace, run))[:, 0]


def measured_spectrum(problem: Problem, trace: Trace, run) -> np.ndarray:
    q, v, a = moved(problem, run)
    y = {"displacement": q, "velocity": v, "acceleration": a}[problem.model.output] @ run.assembly.C.T
    return trace.spectrum(y)[:, :, None]


def mode_spectra(s: SeenMotion, c: Array, w0: Array, zeta: Array) -> np.ndarray:
    """(m, F) force on c of hidden masses of 1 kg that resonate at w0 (m,) rad/s with damping ratio zeta (m,)."""
    return s.trace.spectrum(s.q @ c) * mode_responses(s.trace, w0, zeta)


def mode_responses(trace: Trace, w0: Array, zeta: Array) -> np.ndarray:
    """(m, F) force of hidden masses of 1 kg for a unit of displacement."""
    w = trace.omega
    loss = 2j * (zeta * w0)[:, None] * w
    square = (w0**2)[:, None]
    return -(w**2) * (square + loss) / (square - w**2 + loss)


def mode_column(problem: Problem, s: SeenMotion, mode: Effect) -> np.ndarray:
    """(F, ny) response to one hidden mode."""
    w0, zeta = np.array([2 * np.pi * mode.value("frequency")]), np.array([mode.value("damping_ratio")])
    c = direction(mode.dof, problem.model.n)
    return -mode.value("mass") * (s.G[:, :, : len(c)] @ c) * mode_spectra(s, c, w0, zeta).T
