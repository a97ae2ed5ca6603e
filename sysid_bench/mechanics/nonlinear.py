"""plant or model with effects, sampled input and its hold -> motion. The simulation of everything that is not linear.

Promise: with `substeps` small steps per sample the linear part is exact for zoh and foh inputs, and the effects'
forces are second-order accurate in h / substeps (tests/test_nonlinear.py holds this against DOP853 and Radau).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.assembly import assemble, measured
from sysid_bench.mechanics.stages import stage_values
from sysid_bench.mechanics.trajectory import trajectory
from sysid_bench.nouns import Array, Diverged, Model, Plant


@dataclass(frozen=True, eq=False)
class Motion:
    """q, v, a (N, n) displacement, velocity, acceleration of the model's own DOFs; y (N, ny) what is measured."""

    q: Array
    v: Array
    a: Array
    y: Array


def simulate(
    plant: Plant | Model,
    u: Array,
    h: float,
    hold: str,
    *,
    x0: Array | None = None,
    substeps: int = 8,
    period: int | None = None,
    series=None,
    t0: float = 0.0,
) -> Motion:
    """Motion of a plant with any effects on a sampled input u (N, nu). x0 (2 n,): q and q' at the first sample.

    Raises Diverged where the motion leaves every bound, InputError for a place outside the plant.
    """
    assembly = assemble(plant)
    for effect in assembly.actuators:
        hold = getattr(effect, "hold", hold)
    stages = stage_values(u, h, hold, substeps, series, period)
    run = trajectory(assembly, stages, h, substeps, x0, t0)
    if not np.isfinite(run.X[-1]).all():
        k = int(np.argmax(~np.isfinite(run.X).all(axis=1))) // substeps
        raise Diverged(f"the simulated motion leaves every bound at sample {k} (t = {t0 + k * h:g} s)")
    q, v, a = run.motion()
    y = measured(assembly, plant.output, q, v, a, t0 + np.arange(len(u)) * h)
    own = assembly.n_own
    return Motion(q[:, :own], v[:, :own], a[:, :own], y)
