"""a discrete state-space model from anybody -> Estimate: poles, and M, D, K where it can be projected."""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Any

import numpy as np

from sysid_bench.mechanics.conversion import d2c, modes
from sysid_bench.mechanics.projection import project
from sysid_bench.nouns import Array, Diverged, Estimate, InputError, Model, NotApplicable

EXTRA = "pip install sysid-bench[peers]"


def peer_module(name: str, package: str) -> ModuleType:
    """The module of an optional package. Raises NotApplicable with the way out where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError as problem:
        raise NotApplicable(f"{package} is not installed: {EXTRA} ({problem}).") from None


def estimate_of_black_box(
    Ad: Array, Bd: Array, Cd: Array, Dd: Array, h: float, model: Model, diagnostics: dict[str, Any]
) -> Estimate:
    """Continuous poles by the logarithm; M, D, K by the direct projection where order, sensors and forces allow.

    Ad (nx, nx), Bd (nx, nu), Cd (ny, nx), Dd (ny, nu), h in s. Raises Diverged where a matrix is not finite or a
    pole has no continuous counterpart.
    """
    A, B, C, through = (np.asarray(X, dtype=float) for X in (Ad, Bd, Cd, Dd))
    if not all(np.all(np.isfinite(X)) for X in (A, B, C, through)):
        raise Diverged("the model found is not finite.")
    p, c, b = modes(A, B, C)
    space = (A, B, C, through, h)
    lam, rows = d2c(p, b, h)
    try:
        M, D, K = project((lam, c, rows), model, "direct")
    except (NotApplicable, Diverged, InputError) as problem:
        return Estimate(poles=lam, state_space=space, reason=str(problem), diagnostics=diagnostics)
    return Estimate(M, D, K, None, lam, space, diagnostics=diagnostics)
