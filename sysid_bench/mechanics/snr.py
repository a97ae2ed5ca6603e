"""noise-free output, signal-to-noise ratio -> noise variance per channel."""

from __future__ import annotations

import numpy as np

from sysid_bench.nouns import Array, InputError


def noise_variance(y: Array, snr_db: float | list[float]) -> Array:
    """(ny,): var(y_i) / 10^(snr_db_i / 10). Raises InputError for a wrong number of ratios or a constant output."""
    ratio = np.atleast_1d(np.asarray(snr_db, dtype=float))
    if ratio.ndim != 1 or len(ratio) not in (1, y.shape[1]) or not np.all(np.isfinite(ratio)):
        raise InputError(
            f"snr_db must be one finite number in dB, or one for each of the {y.shape[1]} outputs; got {snr_db!r}."
        )
    power = np.var(y, axis=0)
    if np.any(power <= 0):
        raise InputError(
            f"snr_db needs an output that moves; output {int(np.argmin(power))} is constant. Excite it, or use noise=none."
        )
    with np.errstate(all="ignore"):
        variance = power / 10 ** (ratio / 10)
    if not np.all(np.isfinite(variance)):
        raise InputError(
            f"snr_db of {snr_db!r} makes a noise too large for a number; ratios are some -40 to 200 dB."
        )
    return variance
