"""block replicates of an estimate -> its covariance. For estimators that have no information matrix."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.stats import t as student

from sysid_bench.nouns import Array

NORMAL_97_5 = 1.959963984540054


def blocks(N: int, wanted: int, shortest: int) -> list[slice]:
    """At most `wanted` blocks of nearly equal length of N samples, none shorter than `shortest`; [] below 4."""
    count = min(wanted, N // shortest)
    if count < 4:
        return []
    edges = np.linspace(0, N, count + 1).astype(int)
    return [slice(a, b) for a, b in pairwise(edges)]


def covariance(replicates: Array) -> Array:
    """(J, p) delete-one-block estimates -> (p, p), sum of squared deviations times (J - 1) / J.

    Enlarged by (t / z)^2 at 97.5 %, Student's t of J - 1 degrees of freedom, so that +-1.96 standard errors
    are a 95 % interval although the variance itself was estimated from J blocks (Kunsch, Ann. Stat. 17, 1989).
    """
    J = len(replicates)
    deviations = replicates - replicates.mean(axis=0)
    widening = (student.ppf(0.975, J - 1) / NORMAL_97_5) ** 2
    return widening * (J - 1) / J * deviations.T @ deviations
