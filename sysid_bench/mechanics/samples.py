"""a record as it came (flagged, missing or uneven samples) -> evenly spaced samples and which outputs count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

from sysid_bench.nouns import Array, NotApplicable, Record

GRID_RTOL = 1e-3  # of a step: how near the times must lie to a common grid
MOST_MISSING = 0.5


@dataclass(frozen=True, eq=False)
class Samples:
    """u (N, nu), y (N, ny) evenly h seconds apart; mask (N,): 1 where y was measured, None where everywhere.

    note: what was done to them, empty where nothing was.
    """

    u: Array
    y: Array
    h: float
    mask: Array | None = None
    note: str = ""


def even_samples(record: Record, hold: str) -> Samples:
    """Flagged samples count as missing; times on a grid with holes are filled in, others resampled.

    Raises NotApplicable where more than half is missing.
    """
    good = np.ones(record.N, dtype=bool) if record.quality is None else record.quality == 0
    if record.is_uniform and good.all():
        return Samples(record.u, record.y, record.h)
    if good.mean() < MOST_MISSING:
        raise NotApplicable(f"only {good.sum()} of {record.N} samples are good.")
    steps = np.diff(record.t)
    h = float(np.median(steps))
    grid = np.rint((record.t - record.t[0]) / h)
    h = float((record.t[-1] - record.t[0]) / grid[-1])
    off = np.abs((record.t - record.t[0]) / h - grid).max()
    if off > GRID_RTOL:
        return _resampled(record, good)
    return _on_grid(record, good, grid.astype(int), h, hold)


def _on_grid(
    record: Record, good: NDArray[np.bool_], index: NDArray[np.int_], h: float, hold: str
) -> Samples:
    """Holes in y are bridged and masked; u is kept where it is known, else bridged as the hold would."""
    N = int(index[-1]) + 1
    known = np.isfinite(record.u).all(axis=1)
    if known.mean() < MOST_MISSING:
        raise NotApplicable(f"the input is known at {known.sum()} of {record.N} samples only.")
    u = _bridged(index[known], record.u[known], N, hold)
    y = _bridged(index[good], record.y[good], N, "cubic")
    mask = np.zeros(N)
    mask[index[good]] = 1.0
    unknown = N - int(known.sum())
    note = f"{N - int(mask.sum())} of {N} output samples missing"
    return Samples(u, y, h, mask, note + (f", {unknown} inputs interpolated" if unknown else ""))


def _bridged(index: NDArray[np.int_], x: Array, N: int, hold: str) -> Array:
    if len(index) == N:
        return np.array(x)
    everywhere = np.arange(N)
    if hold == "zoh":
        return x[np.maximum(np.searchsorted(index, everywhere, side="right") - 1, 0)]
    inside = np.clip(everywhere, index[0], index[-1])
    rule = CubicSpline if hold in ("cubic", "bandlimited") else PchipInterpolator
    return rule(index, x, axis=0)(inside)


def _resampled(record: Record, good: NDArray[np.bool_]) -> Samples:
    t, N = record.t[good], record.N
    even = np.linspace(t[0], t[-1], N)
    u, y = (CubicSpline(t, x[good], axis=0)(even) for x in (record.u, record.y))
    return Samples(u, y, float(even[1] - even[0]), None, "uneven times: resampled by a cubic spline")
