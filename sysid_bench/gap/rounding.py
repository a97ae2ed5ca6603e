"""fit -> the same with intervals that hold for other roundings of a sign: how a friction turns over is not known.

A law rounds its step at rest by a tanh; nature may round it otherwise. That shifts what is fitted by more than the noise
where records are long and quiet. The shift to a slower rounding, to first order, is added to the covariance as a
systematic error of one standard deviation (Kennedy, O'Hagan 2001: the discrepancy of a model is part of its error).
"""

from __future__ import annotations

import dataclasses
from dataclasses import replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from sysid_bench.gap.descent import Fit, Place
from sysid_bench.gap.problem import Problem, evaluate
from sysid_bench.mechanics.effect import Effect

MIX = 0.02  # of the slower rounding: small enough for first order


def for_any_rounding(problem: Problem, found: Fit) -> Fit:
    """The fit, its covariance widened by the shift that another rounding of signs brings; as it was without one."""
    effects = tuple(_mixed(e) for e in found.point.effects)
    if found.covariance is None or effects == found.point.effects:
        return found
    other = evaluate(problem, replace(found.point, effects=effects))
    if other is None:
        return found
    here = Place(problem, found.parameters, problem.prior, found.point, found.rows, found.runs)
    shift = found.covariance @ (here.slopes().T @ (other[0] - found.rows)) / (here.weight * MIX)
    if not np.isfinite(shift).all():
        return found
    return replace(found, covariance=found.covariance + np.outer(shift, shift))


def _mixed(effect: Effect) -> Effect:
    """The effect with a share of the slower rounding; itself where it rounds nothing."""
    if not hasattr(effect, "sign"):
        return effect
    values: dict[str, Any] = {f.name: getattr(effect, f.name) for f in dataclasses.fields(effect)}
    return _kind(type(effect))(**values)


@lru_cache(maxsize=64)
def _kind(kind: type[Effect]) -> type[Effect]:
    return type(kind.__name__, (kind,), {"sign": staticmethod(_slower)})


def _slower(x):
    return (1 - MIX) * ca.tanh(x) + MIX * x / ca.sqrt(1 + x * x)
