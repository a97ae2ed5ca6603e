"""repeated motion -> the noise floor of the force: what differs between two laps of the same motion is noise."""

from __future__ import annotations

import numpy as np

from sysid_bench.gap.inverse import ForceProblem, rows_of
from sysid_bench.gap.traces import Trace
from sysid_bench.nouns import Array

ALIKE = 0.01  # two laps are the same motion where they differ by less than this share of its rms
ENOUGH = 0.2  # of a record must be repeated
LAPS, SENSORS = (
    "from what differs between repeated laps",
    "from the sensors' noise at the highest frequencies",
)


def force_floor(problem: ForceProblem, variances: list[Array]) -> tuple[Array, str]:
    """(n,) noise of the force in the band, N, and how it was found.

    variances: (ny,) noise of the displacements per trace, used where no motion is repeated.
    """
    parts = [_between_laps(problem, k) for k in range(len(problem.traces))]
    parts += [_between_records(problem)]
    found = [p for p in parts if p is not None]
    if found:
        return np.sqrt(np.mean(found, axis=0)), LAPS
    M = np.abs(problem.model.matrices[0])
    power = []
    for trace, variance in zip(problem.traces, variances):
        lever = np.sum(trace.omega**4) / (trace.N // 2 + 1)
        input_lattice = 1e-10 * np.mean(trace.u**2)  # what a drive's number format leaves at least
        power.append(lever * (M**2 @ variance) + input_lattice)
    return np.sqrt(np.mean(power, axis=0)), SENSORS


def lap_of(trace: Trace) -> int:
    """Samples after which the motion repeats itself; 0 where it does not."""
    if trace.period:
        return trace.period
    y = trace.y - trace.y.mean(axis=0)
    N = len(y)
    speed = np.abs(np.gradient(y, axis=0)).max(axis=1)
    moving = speed > 0.1 * np.sqrt(np.mean(speed**2))
    Y = np.fft.rfft(y, 2 * N, axis=0)
    match = np.fft.irfft(np.abs(Y) ** 2, 2 * N, axis=0)[:N].sum(axis=1)
    energy = np.cumsum((y**2).sum(axis=1))
    match = match / np.sqrt(np.maximum(energy[::-1] * (energy[-1] - energy + energy[0]), 1e-300))
    match[: int(0.02 * N)], match[int((1 - ENOUGH) * N) :] = -1, -1
    for _ in range(8):
        lag = int(np.argmax(match))
        near = range(max(lag - N // 400 - 2, 1), min(lag + N // 400 + 3, N - 1))
        repeats, _, best = max(_repeats(y, moving, k) for k in near)
        if repeats > ENOUGH:
            return best
        match[max(lag - N // 100, 0) : lag + N // 100] = -1
    return 0


def _repeats(y: Array, moving: np.ndarray, lag: int) -> tuple[float, float, int]:
    """(share of the record that moves and is repeated after the lag, minus the mean difference there, lag)."""
    one, two = y[lag:], y[:-lag]
    same = _same(one, two) & moving[lag:]
    apart = np.abs(one - two)[same].mean() if same.any() else np.inf
    return round(float(np.mean(same)), 2), -float(apart), lag


def _same(one: Array, two: Array) -> np.ndarray:
    return np.all(np.abs(one - two) < ALIKE * np.std(two, axis=0), axis=1)


def _between_laps(problem: ForceProblem, k: int) -> Array | None:
    trace = problem.traces[k]
    lap = lap_of(trace)
    if lap == 0:
        return None
    r = _residual(problem, k)
    same = _same(trace.y[lap:], trace.y[:-lap])
    return _spread(trace, r[lap:] - r[:-lap], same)


def _between_records(problem: ForceProblem) -> Array | None:
    """Of records that follow the same motion from the same start."""
    found = []
    for k in range(1, len(problem.traces)):
        one, two = problem.traces[k - 1], problem.traces[k]
        if one.N != two.N or np.mean(_same(one.y, two.y)) < 0.5:
            continue
        found.append(
            _spread(one, _residual(problem, k) - _residual(problem, k - 1), np.ones(one.N, dtype=bool))
        )
    return np.mean(found, axis=0) if found else None


def _residual(problem: ForceProblem, k: int) -> Array:
    return problem.residual(problem.model, k)


def _spread(trace: Trace, difference: Array, same: np.ndarray) -> Array:
    """(n,) half the mean square of a difference of two residuals, in the band, where the motions are alike."""
    full = np.zeros((trace.N, difference.shape[1]))
    full[: len(difference)] = difference
    rows = rows_of(trace, full)
    place = np.arange(2 * trace.F) / (2 * trace.F) * trace.N
    good = np.zeros(trace.N, dtype=bool)
    good[: len(same)] = same
    kept = good[place.astype(int)] & (place > 0.06 * trace.N) & (place < 0.94 * len(difference))
    return np.mean(rows[kept] ** 2, axis=0) / 2
