"""positive semidefinite matrix, right-hand sides -> the least-squares solution, in units that suit it."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dpocon, dpotrf, dpotrs

from sysid_bench.nouns import Array


def solved(A: Array, B: Array, blind: float) -> Array:
    """X (n, ...) of A X = B, A (n, n) symmetric, scaled to a unit diagonal first.

    Of minimal norm where A's smallest singular value is below `blind` times the largest, as far as the condition's
    estimate tells; by Cholesky, at a tenth of the cost, elsewhere.
    """
    d = np.sqrt(np.maximum(A.diagonal(), 1e-300))
    scaled = A / d / d[:, None]
    units = d if B.ndim == 1 else d[:, None]
    right = B / units
    factor, failed = dpotrf(scaled)
    if not failed and dpocon(factor, len(d))[0] > 10 * blind:  # with a unit diagonal no row sums to more
        return dpotrs(factor, right)[0].reshape(B.shape) / units
    if not (np.isfinite(scaled).all() and np.isfinite(right).all()):
        return np.full(B.shape, np.nan)  # LAPACK may never come back from these
    return np.linalg.lstsq(scaled, right, rcond=blind)[0] / units
