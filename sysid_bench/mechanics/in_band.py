"""record -> its spectra on the frequency band that carries the response.

A linear system at N samples is a set of N/2 independent complex equations. Those above the band hold noise
only; leaving them out costs no information and makes the work independent of the sampling rate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.fft import rfft
from scipy.ndimage import uniform_filter1d

from sysid_bench.mechanics.hold_spectra import drive_spectra
from sysid_bench.nouns import Array, Complex, NotApplicable

MARGIN = 1.2  # the band ends this much above the last bin in which the response is seen
SIGNIFICANCE = 8.0  # standard deviations above the noise floor
FLOOR_BLOCKS = 12  # about
SMOOTH = 11  # bins
SHORTEST = 16


@dataclass(frozen=True, eq=False)
class Spectra:
    """All bins of one uniform record, scaled so that white noise of variance v has E|Y_f|^2 = 2 v.

    omega (F,) rad/s, z (F, 1) = exp(j omega h), U (F, nu), Y (F, ny), weight (F,): sqrt(2/N), sqrt(1/N) at zero and Nyquist;
    drive (some bins, J, nu): spectra of what drives the held input (see `driven`); mask (N,): 1 where y was measured,
    None where everywhere. u, y: the samples, with gaps filled; note: what was done to them.
    """

    u: Array
    y: Array
    h: float
    hold: str
    period: int
    omega: Array
    z: Complex
    weight: Array
    U: Complex
    Y: Complex
    drive: Complex | None = None
    mask: Array | None = None
    note: str = ""

    @property
    def N(self) -> int:
        return len(self.u)

    @cached_property
    def power(self) -> Array:
        """(F, ny) |Y|^2."""
        return squared(self.Y)


def spectra(
    u: Array, y: Array, h: float, hold: str, period: int | None = None, mask: Array | None = None
) -> Spectra:
    """The spectra of samples u (N, nu), y (N, ny), h seconds apart."""
    N = len(u)
    omega = 2 * np.pi * np.arange(N // 2 + 1) / (N * h)
    weight = np.full(len(omega), np.sqrt(2.0 / N))
    weight[0] = np.sqrt(1.0 / N)
    if N % 2 == 0:
        weight[-1] = weight[0]
    U, Y = (rfft(x, axis=0) * weight[:, None] for x in (u, y))
    return Spectra(
        u, y, h, hold, period or N, omega, np.exp(1j * omega * h)[:, None], weight, U, Y, mask=mask
    )


def driven(data: Spectra, F: int) -> Spectra:
    """With what drives the held input in the first F bins; a band-limited one is driven by its own spectrum.

    Raises NotApplicable for too few samples.
    """
    if data.hold == "bandlimited":
        return data
    drive = drive_spectra(data.u, data.U[:F], data.z[:F], data.weight[:F, None], data.hold)
    return replace(data, drive=drive)


def squared(X: Complex) -> Array:
    """|X|^2 of X (F, m), without a root on the way."""
    return X.real**2 + X.imag**2


def observations(weight: Array) -> int:
    """Real numbers in the bins: two each, one at zero frequency and at Nyquist."""
    single = np.count_nonzero(weight < 0.9 * weight.max())
    return 2 * len(weight) - int(single)


def thinned(data: Spectra, F: int, bins: int) -> tuple[Spectra, int]:
    """Every so many-th of the first F bins, about `bins` of them: enough to start from, at a fraction of the cost.

    Unchanged where the likelihood needs all bins (missing samples, several periods).
    """
    stride = F // bins
    if stride < 2 or data.mask is not None or (data.drive is None and data.period != data.N):
        return data, F
    parts = {name: getattr(data, name)[:F:stride] for name in ("omega", "z", "weight", "U", "Y")}
    sparse = replace(data, **parts, drive=None if data.drive is None else data.drive[:F:stride])
    return sparse, len(sparse.omega)


def noise_floor(power: Array) -> Array:
    """Lowest smoothed power per channel (ny,), E|Y_f|^2 where the response is least; power (F, ny)."""
    power = uniform_filter1d(power, SMOOTH, axis=0, mode="nearest")
    size = max(len(power) // FLOOR_BLOCKS, 1)
    blocks = power[: len(power) // size * size].reshape(-1, size, power.shape[1])
    return np.maximum(np.median(blocks, axis=1).min(axis=0), 1e-24 * power.max(axis=0))


def band_edge(data: Spectra) -> int:
    """Number of bins that carry the response: MARGIN beyond the last one that stands out of the noise floor.

    The floor is the least smoothed power, then the mean power above the band; where the response fills the
    whole spectrum, so does the band. Raises NotApplicable for an output that does not move.
    """
    still = (data.y == data.y[0]).all(axis=0)
    if still.any():
        raise NotApplicable(f"output channel {still.argmax()} never moves.")
    floor, width = noise_floor(data.power), SMOOTH
    for _ in range(2):
        edge = _edge(data.power, floor, width)
        width = int(np.clip(edge // 6, SMOOTH, 4 * SMOOTH))
        above = power_above(data, edge)
        floor = floor if above is None else above
    return edge


def power_above(data: Spectra, edge: int) -> Array | None:
    """Mean power of the bins above the band (ny,): the noise's; None where too few of them are left."""
    F = len(data.omega)
    return data.power[edge:-1].mean(axis=0) if F - edge > max(F // 8, 64) else None


def _edge(power: Array, floor: Array, width: int) -> int:
    excess = uniform_filter1d(power @ (1 / floor) / len(floor), width, mode="mirror")
    excess = excess[: len(power) - width]  # fewer bins under the smoother's end
    above = np.flatnonzero(excess > 1 + SIGNIFICANCE / np.sqrt(width * power.shape[1]))
    last = above[-1] + 1 if len(above) else len(power)
    return int(np.clip(np.ceil(MARGIN * last), min(len(power), SHORTEST), len(power)))
