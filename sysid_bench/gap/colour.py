"""residual -> the noise's variance and colour, told from the frequencies above all that the plant does.

A sensor's noise is seldom white. Where the highest frequencies fall off as a first-order autoregression does
(e[k] = phi e[k-1] + white), its spectrum is continued into the band; where they are flat, phi is zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.nouns import Array

STARTS = (0.04, 0.08, 0.15, 0.3)  # of Nyquist: from where on a record may show noise only
BLOCK = 40  # bins whose mean is compared with the fit
LINE = 10.0  # times the usual power: more is a line, not noise
GRID = np.linspace(0, 0.95, 96)  # of phi
LEAST = 0.15  # phi below which noise counts as white
CLEARLY = 40.0  # log likelihood by which a sloping spectrum must beat a flat one; a window doubles it
ALIKE = 5.0  # log likelihood that a colour may lack and still be likely
LOWEST, LEVEL, SPREAD = 5, 0.25, 0.35  # of a fit: the lowest blocks and all blocks, in logarithms


@dataclass(frozen=True, eq=False)
class Floor:
    """Noise per channel: variance (ny,), and phi (ny,) of its first-order autoregression."""

    variance: Array
    phi: Array

    def density(self, omega_h: Array) -> Array:
        """(F, ny) variance per bin at omega h rad: the spectrum, whose mean over all bins is the variance."""
        return self.variance * shape(self.phi, omega_h[:, None])

    def smaller(self, other: Floor) -> Floor:
        """Per channel the one that is lower at the highest frequency."""
        mine = self.density(np.array([np.pi]))[0] <= other.density(np.array([np.pi]))[0]
        return Floor(np.where(mine, self.variance, other.variance), np.where(mine, self.phi, other.phi))


def mean_floor(floors: list[Floor]) -> Floor:
    """Of several records with one sensor each channel."""
    return Floor(np.mean([f.variance for f in floors], axis=0), np.mean([f.phi for f in floors], axis=0))


def shape(phi, angle):
    """Spectrum of unit variance of e[k] = phi e[k-1] + white."""
    return (1 - phi**2) / (1 + phi**2 - 2 * phi * np.cos(angle))


def coloured(power: Array, lowest: float = 0.0) -> tuple[float, float] | None:
    """(variance, phi) of noise whose periodogram is `power` (bins 0..Nyquist); None where it is white, or no noise.

    The lowest start from which a first-order spectrum fits all that lies above: the further down noise is seen,
    the surer its continuation. lowest: share of Nyquist below which the plant itself is heard; there only such a
    spectrum counts as is likely by what lies above alone, for a slope far up hardly tells a strong colour's size.
    """
    lowest = min(lowest, STARTS[-1])
    above = next(filter(None, (_fitted(power, s) for s in STARTS if s >= lowest)), None)
    if above is None or above.phi < LEAST or above.gain < CLEARLY:
        return None
    below = filter(None, (_fitted(power, s) for s in STARTS if s < lowest))
    best = next((b for b in below if above.allows(b.phi)), above)
    return best.variance, best.phi


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A first-order spectrum, and its log likelihood at every phi of GRID."""

    variance: float
    phi: float
    likelihood: Array

    @property
    def gain(self) -> float:
        """Of likelihood over white."""
        return self.likelihood.max() - self.likelihood[0]

    def allows(self, phi: float) -> bool:
        return self.likelihood.max() - self.likelihood[np.searchsorted(GRID, phi)] < ALIKE


def _fitted(power: Array, start: float) -> _Fitted | None:
    """By Whittle's likelihood, from `start` of Nyquist on; None where the spectrum has another shape.

    Lines are cut to what noise may show.
    """
    first = int(start * len(power))
    count = (len(power) - 1 - first) // BLOCK
    if count < 8:
        return None
    kept = slice(first, first + count * BLOCK)
    blocks = power[kept].reshape(count, BLOCK)
    usual = np.median(blocks, axis=1, keepdims=True) / np.log(2)
    P = np.minimum(blocks, LINE * usual).ravel()
    shapes = shape(GRID[:, None], np.linspace(0, np.pi, len(power))[kept])
    sizes = np.mean(P / shapes, axis=1)
    likelihood = -len(P) * np.log(np.maximum(sizes, 1e-300)) - np.log(shapes).sum(axis=1)
    best = int(np.argmax(likelihood))
    over = np.log(np.maximum((P / (sizes[best] * shapes[best])).reshape(count, BLOCK).mean(axis=1), 1e-300))
    if abs(over[:LOWEST].mean()) > LEVEL or over.std() > SPREAD:
        return None  # a response that falls off, not noise
    return _Fitted(float(sizes[best]), float(GRID[best]), likelihood)
