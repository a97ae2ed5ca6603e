"""spectra of one or several records, M, D, K -> the likelihood: residuals, free motions, noise weights.

The residual is exact for the hold; the free motion of every record is solved for and the noise weight re-estimated at
each point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.fft import irfft, rfft

from sysid_bench.mechanics import normal_equations as ne
from sysid_bench.mechanics.equation import Equation, equation_of
from sysid_bench.mechanics.hold_spectra import hold_spectrum
from sysid_bench.mechanics.in_band import Spectra, observations, power_above, squared
from sysid_bench.mechanics.noise_weight import estimated, given, modal_gram, weigh
from sysid_bench.mechanics.response import Image, Maps, Modes, image, modes_of, output_modes, sampled
from sysid_bench.mechanics.second_order import unpack
from sysid_bench.mechanics.semidefinite import solved
from sysid_bench.nouns import Array, Complex, Diverged


@dataclass(frozen=True, eq=False)
class Fold:
    """An image of the frequency axis, or several: s (..., F), the held input's spectrum (..., F, nu), the turns (..., F, 3)
    of the gradient there."""

    s: Complex
    held: Complex
    turns: Complex

    def motion(self, modes: Modes, maps: Maps, bins: slice, free: Complex) -> Image:
        return image(modes, maps, self.s[..., bins], self.held[..., bins, :], free)


@dataclass(frozen=True, eq=False)
class Run:
    """One record in the likelihood: its spectra, maps, number of bins, kind of noise or a given weight."""

    data: Spectra
    maps: Maps
    F: int
    noise: str = "diagonal"
    weight: Array | None = None

    @cached_property
    def count(self) -> float:
        share = 1.0 if self.data.mask is None else float(self.data.mask.mean())
        return share * observations(self.data.weight[: self.F])

    @cached_property
    def power(self) -> Array:
        return np.maximum(self.data.power[: self.F].mean(axis=0), 1e-300)

    @cached_property
    def edge(self) -> int:
        """Bins from here on hold noise only."""
        return max(self.F, len(self.data.omega) // 4)

    @cached_property
    def above(self) -> Array | None:
        """(ny,) mean power of the noise above the band; None where too few bins are left."""
        found = power_above(self.data, self.edge)
        return None if found is None or not np.all(found > 0) else found

    @cached_property
    def equation(self) -> Equation:
        return equation_of(self.data, self.maps, self.F)

    @cached_property
    def main(self) -> Fold:
        return self._fold(np.zeros(()))

    @cached_property
    def sides(self) -> Fold | None:
        """The neighbouring images (2, F, ...); None where the hold leaves none."""
        return None if self.data.hold == "bandlimited" else self._fold(np.array([[-1.0], [1.0]]))

    def _fold(self, m: Array) -> Fold:
        data, omega = self.data, self.data.omega[: self.F] + 2 * np.pi * m / self.data.h
        held = data.U[: self.F] * hold_spectrum(omega, data.h, data.hold)[..., None]
        return Fold(1j * omega, held, ne.turned(1j * omega))


@dataclass(frozen=True, eq=False)
class Fitted:
    """A run at a point: residual (F, ny), modal start (2n,), its spectra (F, 2n), noise weight, cost."""

    R: Complex
    start: Complex
    free: Complex
    W: Array
    cost: float


@dataclass(frozen=True, eq=False)
class Point:
    """The likelihood at theta (ntheta,): the modes there, each run's fit, the cost."""

    theta: Array
    modes: Modes
    runs: tuple[Fitted, ...]
    cost: float


def evaluate(theta: Array, runs: Sequence[Run], before: Sequence[Fitted] | None = None) -> Point:
    """The likelihood at theta. Raises Diverged where the matrices cannot be simulated."""
    modes = modes_of(*unpack(theta, runs[0].maps.n))
    fitted = tuple(_fit_run(modes, run, None if before is None else before[k]) for k, run in enumerate(runs))
    cost = sum(f.cost for f in fitted)
    if not np.isfinite(cost):
        raise Diverged("the likelihood is not finite.")
    return Point(theta, modes, fitted, cost)


def unexplained(point: Point, runs: Sequence[Run]) -> float:
    """Residual power in the band over the noise above it, over what chance allows: below 1 is well, 0 says that there is
    nothing above the band to judge by."""
    worst = 0.0
    for run, fitted in zip(runs, point.runs):
        if run.above is not None:
            ratio = float((squared(fitted.R).mean(axis=0) / run.above).max())
            chance = 1 + 5 * np.sqrt(1 / run.F + 1 / (len(run.data.omega) - run.edge))
            worst = max(worst, ratio / chance)
    return worst


def _fit_run(modes: Modes, run: Run, before: Fitted | None) -> Fitted:
    data, F = run.data, run.F
    bins = F if data.mask is None else len(data.omega)
    W = run.weight if run.weight is not None else before.W if before is not None else None
    if W is None:
        W = 1 / run.power[None]
    found, c = sampled(modes, run.maps, data, bins), output_modes(modes, run.maps)
    Y, free = found.forced, found.free
    gram = np.real(np.conj(modes.inverse).T @ modal_gram(free[:F], c, W) @ modes.inverse)
    R, start = _residual(data, Y)[:F], np.zeros(2 * modes.n, dtype=complex)
    for _ in range(1 if data.mask is None else 4):  # with gaps the gram is that of the complete record
        slope = (modes.inverse.T @ (free[:F] * (np.conj(weigh(W, R)) @ c)).sum(axis=0)).real
        start = start + modes.inverse @ solved(gram, slope, ne.BLIND)
        R = _residual(data, Y + free @ (c * start).T)[:F]
    if run.weight is not None:
        return Fitted(R, start, free[:F], run.weight, given(R, run.weight))
    return Fitted(R, start, free[:F], *estimated(R, run.power, run.count, run.noise))


def _residual(data: Spectra, Y: Complex) -> Complex:
    if data.mask is None:
        return data.Y[: len(Y)] - Y
    y = irfft(Y / data.weight[:, None], data.N, axis=0)
    return rfft(data.mask[:, None] * (data.y - y), axis=0) * data.weight[:, None]
