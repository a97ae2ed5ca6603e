"""device times and times of arrival -> the device's clock against the host's, by a fit that delays cannot pull."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.nouns import Array

BLOCKS = 60
SIGNIFICANT = 8.0  # block minima are not independent of each other


@dataclass(frozen=True)
class ClockFit:
    """host time = offset_s + scale * device time, the line of the frames that came with least delay.

    drift_ppm, drift_std_ppm  how much longer a device second is than a host second
    jitter_s, delay_p99_s     of the arrivals above that line: rms about their median, 99th percentile
    significant               |drift| above 8 standard errors: only then sample times are stretched by it
    """

    offset_s: float
    scale: float
    drift_ppm: float
    drift_std_ppm: float
    jitter_s: float
    delay_p99_s: float

    @property
    def significant(self) -> bool:
        return abs(self.drift_ppm) > SIGNIFICANT * self.drift_std_ppm

    def delays(self, device_s: Array, host_s: Array) -> Array:
        """s that each frame came after the line."""
        return host_s - self.offset_s - self.scale * device_s


def fit_clock(device_s: Array, host_s: Array) -> ClockFit | None:
    """Theil-Sen line through the least delayed frame of each of 60 blocks; None under 20 frames.

    Delays only ever add: block minima touch the true line (Paxson, On calibrating measurements of packet
    transit times, 1998); the median of slopes (Sen, 1968) stands 29 % of outlying blocks.
    """
    if len(device_s) < 20:
        return None
    start = host_s[0] - device_s[0]
    lag = host_s - device_s - start
    blocks = np.array_split(np.arange(len(lag)), min(BLOCKS, len(lag) // 4))
    low = np.array([block[np.argmin(lag[block])] for block in blocks])
    x, y = device_s[low], lag[low]
    i, j = np.triu_indices(len(x), 1)
    far = x[j] - x[i] > 0.2 * (x[-1] - x[0])  # neighbours say little about a slope
    slopes = (y[j] - y[i])[far] / (x[j] - x[i])[far]
    slope = float(np.median(slopes))
    rest = lag - slope * device_s
    offset = float(np.median(rest[low]))
    std = _slope_std(x, y, slope)
    above = rest - offset
    return ClockFit(
        start + offset,
        1 + slope,
        1e6 * slope,
        1e6 * std,
        float(np.std(above)),
        float(np.quantile(above, 0.99)),
    )


def _slope_std(x: Array, y: Array, slope: float) -> float:
    """Standard error of the slope from the robust scatter of the block minima."""
    rest = y - slope * x
    scatter = 1.4826 * np.median(np.abs(rest - np.median(rest)))
    return float(max(scatter, 1e-6) / np.sqrt(np.sum((x - x.mean()) ** 2)))
