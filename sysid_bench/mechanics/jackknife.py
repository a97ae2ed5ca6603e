"""block replicates of an estimate -> its covariance. For estimators that have no information matrix."""

from __future__ import annotations

from collections.abc import Sequence
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


def covariance(replicates: Sequence[Array | None]) -> Array | None:
    """J delete-one-block estimates (p,) -> (p, p): the sum of their squared deviations times (J - 1) / J.

    Enlarged by (t / z)^2 at 97.5 %, Student's t of J - 1 degrees of freedom, so that +-1.96 standard errors
    are a 95 % interval although the variance itself was estimated from J blocks (Kunsch, Ann. Stat. 17, 1989).
    Replicates that do not exist (None) are taken to vary like the rest; None where fewer than half exist.
    """
    found = np.array([x for x in replicates if x is not None])
    J = len(replicates)
    if J < 2 or len(found) < J / 2:
        return None
    deviations = found - found.mean(axis=0)
    widening = (student.ppf(0.975, len(found) - 1) / NORMAL_97_5) ** 2
    return widening * (J - 1) / len(found) * deviations.T @ deviations
