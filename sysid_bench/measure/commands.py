"""excitation, rig -> the forces of a whole run, sample by sample, held by the device from tick to tick."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid_bench.nouns import Array, Excitation, InputError

MOST = 10_000_000  # samples of a run


@dataclass(frozen=True, eq=False)
class Commands:
    """u (Ntotal, nu): run-in, record, run-out. The record is samples first .. first + N - 1.

    period: samples of one period where the record repeats itself, else None.
    """

    u: Array
    first: int
    N: int
    period: int | None

    @property
    def total(self) -> int:
        return len(self.u)

    @property
    def record(self) -> Array:
        return self.u[self.first : self.first + self.N]


def commands(
    excitation: Excitation,
    rig: Any,
    seconds: float,
    periods: int,
    amplitude: float,
    soft_start_s: float,
    rng: np.random.Generator,
) -> Commands:
    """The forces of a run, rounded as the rig's frames carry them.

    seconds is the length of one period; the signal is repeated `periods` times. The run-in, over soft_start_s,
    is the end of a periodic signal, else its first force, raised softly from zero; the run-out falls to zero.
    Raises InputError for a run without samples, and for one of more than MOST.
    """
    h, nu = 1 / rig.rate_hz, len(rig.input_channels)
    if (seconds * periods + 2 * soft_start_s) * rig.rate_hz > MOST:
        raise InputError(
            f"a run holds at most {MOST:,} samples, {MOST / rig.rate_hz:.4g} s; got seconds={seconds:g}, "
            f"periods={periods}, soft_start_s={soft_start_s:g}."
        )
    N = round(seconds * rig.rate_hz)
    if N < 2 or periods < 1:
        raise InputError(
            f"a run needs at least 2 samples and one period; got seconds={seconds:g}, periods={periods}."
        )
    signal = excitation.signal(N, h, nu, rng)
    u = amplitude * np.tile(signal.u, (periods, 1))
    soft = round(soft_start_s * rig.rate_hz)
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, soft + 1) / (soft + 1))[:, None]
    period = N if periods > 1 else signal.period
    run_in = ramp * (u[:1] if period is None else u[np.arange(len(u) - soft, len(u)) % len(u)])
    run_out = (1 - ramp) * u[-1]
    whole = np.concatenate([run_in, u, run_out, np.zeros((1, nu))])
    return Commands(carried(rig, whole), soft, len(u), period)


def carried(rig: Any, u: Array) -> Array:
    """u (N, nu) as it comes out of the rig's frames: in the resolution of the signals."""
    out = np.empty_like(u)
    for i, channel in enumerate(rig.input_channels):
        signal = rig.database.get_message_by_name(channel.message).get_signal_by_name(channel.signal)
        out[:, i] = _carried(signal, u[:, i] / channel.scale) * channel.scale
    return out


def _carried(signal: Any, values: Array) -> Array:
    if signal.is_float:
        return values.astype(np.float32 if signal.length == 32 else np.float64).astype(np.float64)
    raw = np.round((values - signal.offset) / signal.scale)
    return raw * signal.scale + signal.offset
