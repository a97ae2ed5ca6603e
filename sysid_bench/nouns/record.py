"""A record: the sampled input and output of one run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid_bench.nouns.words import HOLDS, UNIFORM_STEP_RTOL, Array, Hold, InputError, frozen_array


@dataclass(frozen=True, eq=False)
class Record:
    """Sampled input and output of one run, from simulation, a rig or a file; frozen.

    t        (N,)     sample times, s, strictly increasing
    u        (N, nu)  input at the sample times
    y        (N, ny)  output at the sample times
    hold     how u runs between samples; None where the file does not say. zoh: u_k over [t_k, t_k+1);
             foh: straight lines; cubic: the not-a-knot cubic spline through the samples; bandlimited:
             the Fourier series of one period (`period` samples; the whole record where period is None)
    quality  (N,)     bits (LOST, ...) of nouns; 0 = good. None = all good
    period   samples of one period of a periodic excitation, None where there is none
    units    {"t": "s", "u": [nu strings], "y": [ny strings]}, may be empty
    origin   what made it: resolved config, seed, versions, file hash

    Raises InputError on wrong shapes, non-finite good samples, and times that do not increase.
    """

    t: Array
    u: Array
    y: Array
    hold: Hold | None = None
    quality: NDArray[np.uint8] | None = None
    period: int | None = None
    units: Mapping[str, Any] = field(default_factory=dict[str, Any])
    origin: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        t = frozen_array(self.t, "Record.t", 1)
        u, y = frozen_array(self.u, "Record.u", 2), frozen_array(self.y, "Record.y", 2)
        if len(t) < 2:
            raise InputError(f"Record needs at least 2 samples; got {len(t)}.")
        for name, array in (("u", u), ("y", y)):
            if len(array) != len(t):
                raise InputError(f"Record.{name} must have shape ({len(t)}, n{name}); got {array.shape}.")
        if not np.all(np.isfinite(t)) or np.any(np.diff(t) <= 0):
            k = int(np.argmax(~(np.diff(t) > 0)))
            raise InputError(
                f"Record.t must increase strictly; sample {k + 1} has t = {t[k + 1]} after {t[k]}."
            )
        if self.hold is not None and self.hold not in HOLDS:
            raise InputError(f"Record.hold must be one of {', '.join(HOLDS)} or None; got {self.hold!r}.")
        quality = None if self.quality is None else np.array(self.quality, dtype=np.uint8)
        if quality is not None and quality.shape != t.shape:
            raise InputError(f"Record.quality must have shape ({len(t)},); got {quality.shape}.")
        good = slice(None) if quality is None else quality == 0
        for name, array in (("u", u), ("y", y)):
            bad = ~np.isfinite(array[good]).all(axis=1)
            if bad.any():
                k = int(np.flatnonzero(bad)[0])
                raise InputError(
                    f"Record.{name} has a value that is not finite at good sample {k} (t = {t[good][k]} s); "
                    "remove it or flag the sample in the quality column."
                )
        for name, value in (("t", t), ("u", u), ("y", y), ("quality", quality)):
            object.__setattr__(self, name, value)

    @property
    def N(self) -> int:
        return len(self.t)

    @property
    def nu(self) -> int:
        return self.u.shape[1]

    @property
    def ny(self) -> int:
        return self.y.shape[1]

    @cached_property
    def is_uniform(self) -> bool:
        """True where every step equals the mean step to 1e-6 relative."""
        steps = np.diff(self.t)
        return bool(np.all(np.abs(steps - steps.mean()) <= UNIFORM_STEP_RTOL * steps.mean()))

    @property
    def h(self) -> float:
        """Sampling time in s. Raises InputError where the steps are uneven."""
        if not self.is_uniform:
            steps = np.diff(self.t)
            k = int(np.argmax(np.abs(steps - np.median(steps))))
            raise InputError(
                f"a constant sampling time is wanted (to {UNIFORM_STEP_RTOL:g} relative); step {k} is "
                f"{steps[k]:g} s against a median of {np.median(steps):g} s. Resample the record, or use a "
                "method that takes uneven times."
            )
        return float((self.t[-1] - self.t[0]) / (self.N - 1))

    @property
    def all_good(self) -> bool:
        return self.quality is None or not self.quality.any()

    def __repr__(self) -> str:
        step = f"{self.h:g} s" if self.is_uniform else "uneven steps"
        bad = 0 if self.quality is None else int(np.count_nonzero(self.quality))
        flagged = f", {bad} flagged" if bad else ""
        source = self.origin.get("source", "unknown origin")
        return (
            f"Record({self.N} samples at {step}, nu={self.nu}, ny={self.ny}, "
            f"hold={self.hold or 'unknown'}{flagged}, {source})"
        )
