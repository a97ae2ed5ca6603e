"""problem -> the same problem whose simulation is held near the motion that really was: a smooth way into the valley.

Friction that sticks, play and several wells make the error of a free run a rough function of the parameters: one event
missed, and everything after differs. With springs and dampers between the model and the smoothed measured motion
(synchronisation; Abarbanel et al. 2009) a fit stays smooth, and what it finds is where the fit by free run starts.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid_bench.gap.motion import Seen
from sysid_bench.gap.problem import Problem
from sysid_bench.mechanics.effect import as_effects
from sysid_bench.nouns import Array, Model

SHARES = (1.0, 0.1)  # springs as strong as the plant's own, then a tenth: on the way to a free run
HELD = 0.3  # the same, to search where no free run follows
DAMPING = 0.7  # of critical, of the dampers beside the springs


def leads(problem: Problem, seens: list[Seen]) -> tuple[Problem, ...]:
    """Problems held ever less near the smoothed motion; none where that motion is not measured itself, nor of pieces."""
    known = _measured(problem.model)
    if not known.any() or problem.held or any(t.part_of for t in problem.traces):
        return ()
    return tuple(replace(nudged(problem, seens, share * known), quick=True) for share in SHARES)


def held_near(problem: Problem, seens: list[Seen]) -> Problem | None:
    """The problem held near the smoothed motion, to be searched there; None where not all of that is measured itself.

    M, D, K stay within a prior of the nominal: a plant that weighs nothing follows any motion that it is held to.
    """
    known = _measured(problem.model)
    return replace(nudged(problem, seens, HELD * known), reach=1.0) if known.all() else None


def nudged(problem: Problem, seens: list[Seen], share: Array) -> Problem:
    """The problem with springs and dampers to the smoothed motion; share (n,) of each DOF's own stiffness."""
    model = problem.model
    M, D, K = model.matrices
    size = np.maximum(np.diag(K), 1e-3 * np.abs(K).max())
    spring = share * size if model.output == "displacement" else 0 * size
    damper = DAMPING * np.sqrt(share * size * np.diag(M))
    held = replace(model, damping=D + np.diag(damper), stiffness=K + np.diag(spring))
    traces = tuple(
        replace(s.trace, pull=s.q * spring + s.v * damper, _stages=dict(s.trace._stages)) for s in seens
    )
    return replace(problem, model=held, traces=traces)


def _measured(model: Model) -> Array:
    """(n,) 1 where a sensor sees the DOF and nothing else; 0 where a sensor's own fault is modelled."""
    if any(e.path in ("sensor", "timing") for e in as_effects(model.effects)):
        return np.zeros(model.n)
    C = model.output_map != 0
    return np.any(C & (C.sum(axis=1) == 1)[:, None], axis=0).astype(float)
