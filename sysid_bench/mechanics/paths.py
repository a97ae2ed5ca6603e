"""memories of the actuator path: compiled recursions over stage values (S, 3, nc)."""

from __future__ import annotations

import math

import numba as nb
import numpy as np


@nb.njit(cache=True)
def lag(stages, ratio, start):
    """First-order lag, exact for an input linear over half steps. ratio = small step / time constant; start (nc,)."""
    out = np.empty_like(stages)
    half = 0.5 * ratio
    keep = math.exp(-half)
    mean = -math.expm1(-half) / half
    for c in range(stages.shape[2]):
        w = start[c]
        for k in range(stages.shape[0]):
            out[k, 0, c] = w
            for s in range(2):
                a, b = stages[k, s, c], stages[k, s + 1, c]
                w = keep * w + (mean - keep) * a + (1.0 - mean) * b
                out[k, s + 1, c] = w
    return out


@nb.njit(cache=True)
def rate_limited(stages, step, start):
    """Follows the input by at most `step` per half small step; start (nc,)."""
    out = np.empty_like(stages)
    for c in range(stages.shape[2]):
        w = start[c]
        for k in range(stages.shape[0]):
            out[k, 0, c] = w
            for s in range(1, 3):
                w += min(max(stages[k, s, c] - w, -step), step)
                out[k, s, c] = w
    return out
