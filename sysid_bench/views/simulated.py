"""record, model, estimate -> the output that the estimate predicts from the input alone, and spectra of both."""

from __future__ import annotations

import numpy as np

from sysid_bench.mechanics.exponential import exponential
from sysid_bench.mechanics.holds import free_response, propagate, recursion
from sysid_bench.mechanics.second_order import state_space
from sysid_bench.nouns import Array, Estimate, Model, Record

LEAST_POWER = 1e-3  # of an input's spectrum, against its peak, for a response to be read from it
GROWTH = 1e6  # a simulation beyond this many times the largest measurement has run away


def simulate(record: Record, model: Model, estimate: Estimate) -> Array | None:
    """(N, ny) free run of the estimate on the record's input, from the initial state that fits best.

    None where there is nothing to simulate: no model, uneven times, an estimate that runs away.
    """
    if not record.is_uniform or not np.all(np.isfinite(record.u)):
        return None
    with np.errstate(all="ignore"):
        system = _sampled(record, model, estimate)
        if system is None:
            return None
        forced, free = system
        good = np.ones(record.N, bool) if record.quality is None else record.quality == 0
        if not (np.isfinite(forced).all() and np.isfinite(free).all()) or np.abs(free).max() > GROWTH:
            return None
        wanted = (record.y - forced)[good].ravel()
        start = np.linalg.lstsq(free[good].reshape(len(wanted), -1), wanted, rcond=None)[0]
        found = forced + free @ start
    runaway = np.abs(found).max() > GROWTH * max(np.abs(record.y[good]).max(), 1e-300)
    return None if runaway else found


def _sampled(record: Record, model: Model, estimate: Estimate) -> tuple[Array, Array] | None:
    """Forced response (N, ny) from rest, and responses (N, ny, nx) to each initial state alone."""
    if estimate.M is not None and estimate.D is not None and estimate.K is not None:
        A, B, C, Dd = state_space(
            estimate.M, estimate.D, estimate.K, model.input_map, model.output_map, model.output
        )
        hold = model.hold or record.hold or "zoh"
        x, Ad = (
            propagate(A, B, record.u, record.h, hold, period=record.period),
            exponential(A * record.h),
        )
    elif estimate.state_space is not None and estimate.state_space[4] > 0:
        Ad, B, C, Dd, _ = estimate.state_space
        x = _discrete(Ad, B, record.u)
    else:
        return None
    free = np.stack([free_response(Ad, record.N, e) @ C.T for e in np.eye(len(Ad))], axis=2)
    return x @ C.T + record.u @ Dd.T, free


def _discrete(Ad: Array, B: Array, u: Array) -> Array:
    return recursion(Ad, u[:-1] @ B.T, np.zeros(len(Ad)))


def fit_numbers(y: Array, predicted: Array) -> list[tuple[float, float, float, float]]:
    """Per channel: fit in percent (100 = exact, 0 = no better than the mean), rms of y, of the residual, and the
    residual's correlation from sample to sample (0 = white)."""
    return [_channel(a, a - b) for a, b in zip(y.T, predicted.T)]


def _channel(y: Array, residual: Array) -> tuple[float, float, float, float]:
    spread = float(np.std(y)) or np.nan
    r = residual - residual.mean()
    correlation = float(r[1:] @ r[:-1] / (r @ r)) if r @ r > 0 else 0.0
    rms = float(np.sqrt(np.mean(residual**2)))
    return 100 * (1 - rms / spread), float(np.sqrt(np.mean(y**2))), rms, correlation


def segments(x: Array, length: int) -> np.ndarray:
    """Hann-windowed spectra (nseg, nf, nx) of half-overlapping segments, each without its mean."""
    starts = range(0, len(x) - length + 1, length // 2)
    parts = np.stack([x[k : k + length] for k in starts])
    parts = parts - parts.mean(axis=1, keepdims=True)
    return np.fft.rfft(parts * np.hanning(length)[:, None], axis=1)


def spectrum(x: Array, h: float, length: int) -> tuple[np.ndarray, np.ndarray]:
    """f (nf,) in Hz without 0, and amplitude density (nf, nx), unit of x per root Hz."""
    power = np.mean(np.abs(segments(x, length)) ** 2, axis=0) * 2 * h / np.sum(np.hanning(length) ** 2)
    return np.fft.rfftfreq(length, h)[1:], np.sqrt(power[1:])


def segment_length(N: int, nu: int) -> int:
    """Samples per segment: enough segments to average over and to tell nu inputs apart."""
    return max(16, int(2 * N / (max(8, 4 * nu) + 1)) // 2 * 2)


def responses(u: Array, y: Array, h: float, length: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """f (nf,), G (nf, ny, nu) by cross spectra (H1), seen (nf,): where the input has the power to tell."""
    U, Y = segments(u, length)[:, 1:], segments(y, length)[:, 1:]
    Suu = np.einsum("sfi,sfj->fij", U, U.conj())
    Syu = np.einsum("sfi,sfj->fij", Y, U.conj())
    weakest = np.linalg.eigvalsh(Suu)[:, 0]
    seen = weakest > LEAST_POWER * weakest.max(initial=0)
    G = np.full(Syu.shape, np.nan, dtype=complex)
    G[seen] = np.linalg.solve(Suu[seen].transpose(0, 2, 1), Syu[seen].transpose(0, 2, 1)).transpose(0, 2, 1)
    return np.fft.rfftfreq(length, h)[1:], G, seen
