"""a method's known bias, its covariance -> diagnostics: how many standard errors it is, and a warning where it rules."""

from __future__ import annotations

from typing import Any

import numpy as np

from sysid_bench.nouns import Array

RULES = (
    1.0  # standard errors of noise: a larger bias makes the interval of noise alone miss the truth too often
)


def bias_remarks(
    bias: Array, covariance: Array | None, name: str, what: str, counted: bool = True
) -> dict[str, Any]:
    """{name: largest |bias| / standard error, "warning": ...}; bias (ntheta,), covariance (ntheta, ntheta) of noise alone.

    what: in words; counted: the intervals hold the bias too. Empty without a covariance.
    """
    if covariance is None:
        return {}
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = (deviation > 0) & np.isfinite(deviation)
    worst = float(np.abs(bias[known] / deviation[known]).max(initial=0.0))
    if worst <= RULES:
        return {name: worst}
    intervals = "the intervals count it" if counted else "the intervals do not count it and are too narrow"
    return {
        name: worst,
        "warning": f"{what} is up to {worst:.2g} standard errors of noise; {intervals}. "
        "method=spline_ml has no such bias",
    }
