"""a free mass, often in closed loop -> the gap on the force: what its position cannot tell.

A position that may drift, or that a controller holds, says little about what is missing; the force does.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid_bench.effects import effect_class
from sysid_bench.gap.motion import force_along, response
from sysid_bench.gap.problem import Problem
from sysid_bench.gap.traces import Trace
from sysid_bench.mechanics.effect import Effect, direction
from sysid_bench.mechanics.nonlinear import actuated, assemble
from sysid_bench.nouns import Array, Model

TAPERED = 0.04  # of a record at either end, where positions may drift
# A drifting position cannot tell these from an offset of the force, which is fitted from the start.
DRIFTING = frozenset({"sensor_bias", "sensor_drift", "constant_force", "sensor_scale"})
# Differences between directions are named where a drive moves freely both ways.
ONLY_FREE = frozenset({"asymmetric_friction"})


def floats(model: Model) -> bool:
    """True where the model can move away freely and every DOF is seen as a displacement."""
    stiffness = np.linalg.eigvalsh(model.stiffness)[0]
    seen = model.output == "displacement" and np.array_equal(model.output_map, np.eye(model.n))
    return bool(seen and stiffness <= 1e-9 * np.linalg.eigvalsh(model.mass)[-1])


def admissible(catalogue: list[type[Effect]], model: Model) -> list[type[Effect]]:
    """The names that such records can carry."""
    if floats(model):
        return [kind for kind in catalogue if kind.name not in DRIFTING]
    return [kind for kind in catalogue if kind.name not in ONLY_FREE]


def with_offset(model: Model) -> Model:
    """The model with an offset of the force on every DOF that is free to drift, zero to begin with."""
    if not floats(model) or any(e.name == "constant_force" for e in model.effects):
        return model
    kind = effect_class("constant_force")
    return replace(model, effects=(*model.effects, *(kind(dof=i, force=0.0) for i in range(model.n))))


def in_force(trace: Trace, problem: Problem) -> Trace:
    """The trace weighted as a force: residuals over the nominal response, their floor from the highest frequencies."""
    ends = np.minimum(np.arange(trace.N), np.arange(trace.N)[::-1]) / (TAPERED * trace.N)
    trace = replace(trace, taper=np.sin(np.pi / 2 * np.minimum(ends, 1.0)) ** 2)
    G = response(assemble(replace(problem.model, effects=())), trace.omega, problem.model.output)
    size = np.abs(np.einsum("fii->fi", G))
    force = np.abs(trace.spectrum(trace.y) / np.maximum(size, 1e-300)) ** 2 / trace.N
    high = force[int(0.6 * len(force)) :]
    sigma = np.sqrt(np.maximum(np.median(high, axis=0) / np.log(2), 1e-300))
    weight = np.sqrt(2 / (trace.N * np.mean(trace.good))) / (size * sigma)
    return replace(trace, weight=weight)


def force_gap(model: Model, trace: Trace) -> float:
    """|F - Fhat| / |F|, both in the trace's band: F the actuated input, Fhat what the model needs for the measured motion."""
    A = assemble(model)
    s = 1j * trace.omega[:, None]
    Y = trace.spectrum(trace.y)
    q, v, a = trace.signal(Y), trace.signal(s * Y), trace.signal(s * s * Y)
    needed = a @ model.mass.T + v @ model.damping.T + q @ model.stiffness.T
    for effect in A.forces:
        c = direction(effect.dof, model.n)
        needed = needed + np.outer(force_along(effect, q @ c, v @ c, trace.h, trace.t0), c)
    given = _input(A, trace) @ model.input_map.T
    inner = slice(int(1.5 * TAPERED * trace.N), -int(1.5 * TAPERED * trace.N))
    given, needed = _in_band(trace, given)[inner], _in_band(trace, needed)[inner]
    return float(np.linalg.norm(given - needed) / np.linalg.norm(given))


def _input(A, trace: Trace) -> Array:
    """(N, nu) input at the samples after the actuators; a held one is the mean of what it was and becomes."""
    substeps = 2
    stages = actuated(A, trace.stages(substeps), trace.h / substeps)
    u = np.concatenate([stages[::substeps, 0], stages[-1:, 2]])
    before = np.concatenate([stages[:1, 0], stages[substeps - 1 :: substeps, 2]])
    return 0.5 * (u + before)


def _in_band(trace: Trace, x: Array) -> Array:
    return trace.signal(trace.spectrum(x))
