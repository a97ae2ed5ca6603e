"""record -> what stands in the way of an estimate before any is made: remarks with advice, or a refusal."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from sysid_bench.mechanics.in_band import SMOOTH, Spectra, band_edge, noise_floor, spectra, squared
from sysid_bench.mechanics.samples import even_samples
from sysid_bench.nouns import Array, NotApplicable, Record

DEAD = 1e-3  # of an input's greatest power: bins below it excite nothing
DEAD_SHARE = 0.1  # of the band
ILL_CONDITIONED = 1e4  # of the inputs' covariance, scaled
FEW_PERIODS = 5.0
ALIASED = 0.1  # of the greatest power, near Nyquist
ABOVE_NOISE = 10.0  # times the floor: from here on an output is a response
COARSE_STEP = 0.1  # of an output's rms


def check_excitation(record: Record, hold: str | None = None) -> list[str]:
    """Remarks, empty where all is well.

    Raises NotApplicable where no estimate of M, D, K is possible at all: no force, forces that are multiples of
    each other, or an output that does not move.
    """
    hold = hold or record.hold or "cubic"
    even = even_samples(record, hold)
    data = spectra(even.u, even.y, even.h, "zoh" if hold == "bandlimited" else hold)
    _refuse(even.u)
    F = band_edge(data)
    return [
        *_inputs_alike(even.u),
        *_unexcited(data, F),
        *_aliased(data),
        *_short(data, F),
        *_coarse(even.y),
    ]


def _refuse(u: Array) -> None:
    moving = np.ptp(u, axis=0) > 0
    if not moving.any():
        raise NotApplicable(
            "no force acts: only ratios of mass, damping and stiffness show. Record with a known force."
        )
    for k in np.flatnonzero(~moving):
        raise NotApplicable(
            f"input {k + 1} is constant: its column of the input map cannot be told. Drive it or leave it out."
        )
    if np.linalg.matrix_rank(u - u.mean(axis=0), tol=1e-9 * np.linalg.norm(u)) < u.shape[1]:
        raise NotApplicable("the inputs are multiples of each other: drive them by independent signals.")


def _inputs_alike(u: Array) -> list[str]:
    centred = (u - u.mean(axis=0)) / u.std(axis=0)
    condition = float(np.linalg.cond(centred.T @ centred))
    if condition < ILL_CONDITIONED:
        return []
    return [
        f"the inputs are nearly multiples of each other (condition {condition:.0e}): use independent signals"
    ]


def _unexcited(data: Spectra, F: int) -> list[str]:
    """Inputs without content where the plant's gain is greatest, as far as the output shows it above its noise."""
    U, Y = _tapered(data.U), _tapered(data.Y)
    inputs = uniform_filter1d(np.abs(U[:F]) ** 2, SMOOTH, axis=0, mode="nearest")
    outputs = uniform_filter1d(squared(Y[:F]), SMOOTH, axis=0, mode="nearest")
    seen = np.maximum(outputs - ABOVE_NOISE * noise_floor(squared(Y)), 0).sum(axis=1)
    gain = seen / np.maximum(inputs.sum(axis=1), 1e-300)
    said = []
    for k, column in enumerate(inputs.T):
        dead = column < DEAD * column.max()
        if dead.mean() > DEAD_SHARE and gain[dead].max() > gain[~dead].max(initial=0.0):
            low, high = data.omega[:F][dead & (gain > gain[~dead].max(initial=0.0))][[0, -1]] / (2 * np.pi)
            said.append(
                f"input {k + 1} has next to nothing at {low:.3g} to {high:.3g} Hz, where the plant responds most: "
                "excite these frequencies"
            )
    return said


def _tapered(X: Array) -> Array:
    """Spectrum of the same record under a Hann window: what leaks from its ends is no response to the force."""
    padded = np.concatenate([X[1:2].conj(), X, X[-1:]])
    return X - 0.5 * (padded[:-2] + padded[2:])


def _aliased(data: Spectra) -> list[str]:
    power = uniform_filter1d((data.power / noise_floor(data.power)).mean(axis=1), SMOOTH, mode="nearest")
    if power[-2 * SMOOTH :].mean() < ALIASED * power.max():
        return []
    return [
        f"the response is strong up to the Nyquist frequency ({0.5 / data.h:.3g} Hz): sample faster, or filter before"
    ]


def _short(data: Spectra, F: int) -> list[str]:
    power = uniform_filter1d(data.power[:F].sum(axis=1), 3, mode="nearest")
    lowest = int(np.flatnonzero(power > 0.2 * power.max())[0])
    if lowest >= FEW_PERIODS:
        return []
    return [
        f"the record holds fewer than {FEW_PERIODS:g} periods of its slowest strong motion "
        f"({data.N * data.h:.3g} s in all): damping will be uncertain; record longer"
    ]


def _coarse(y: Array) -> list[str]:
    said = []
    for k, column in enumerate(y.T):
        levels = np.unique(column)
        step = np.diff(levels).min(initial=np.inf)
        if len(levels) < len(column) / 10 and step > COARSE_STEP * column.std():
            said.append(
                f"output {k + 1} has {len(levels)} levels, {step / column.std():.2g} of its rms apart: its quantisation "
                "is the noise; drive harder or use a finer range"
            )
    return said
