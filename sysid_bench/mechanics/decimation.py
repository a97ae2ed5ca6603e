"""samples -> every r-th sample after a linear-phase low-pass: subspace steps want few samples per period."""

from __future__ import annotations

import numpy as np
from scipy.signal import fftconvolve, firwin

from sysid_bench.nouns import Array

TAPS_PER_FACTOR = 8
PASSBAND = 0.8  # of the new Nyquist frequency


def decimate(x: Array, factor: int) -> Array:
    """(N', m) of x (N, m); the same filter on inputs and outputs leaves their relation as it was."""
    if factor <= 1:
        return x
    half = TAPS_PER_FACTOR * factor
    taps = firwin(2 * half + 1, PASSBAND / factor)
    return fftconvolve(x, taps[:, None], mode="valid", axes=0)[::factor]


def decimation_factor(h: float, top: float, N: int, per_period: float = 8.0, fewest: int = 200) -> int:
    """Largest factor that keeps `per_period` samples in the period of `top` (rad/s) and `fewest` samples."""
    wanted = int(2 * np.pi / (top * h * per_period))
    longest = next((r for r in range(max(wanted, 1), 1, -1) if (N - 16 * r) // r >= fewest), 1)
    return max(1, longest)
