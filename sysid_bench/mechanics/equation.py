"""spectra -> both sides of M q'' + D q' + K q = L u in the band, as the linear steps use them: motion, force, ends."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid_bench.mechanics import normal_equations as ne
from sysid_bench.mechanics.hold_spectra import hold_spectrum
from sysid_bench.mechanics.in_band import Spectra
from sysid_bench.mechanics.response import Maps
from sysid_bench.nouns import Array, Complex


@dataclass(frozen=True, eq=False)
class Equation:
    """omega (F,) rad/s; Q (F, n) the motion seen; force (F, n) under its hold; w (F,) of the record's ends and the powers
    of s that multiply it: s^2 (folding), s, 1 and one 1/s per integration."""

    omega: Array
    Q: Complex
    force: Complex
    w: Array
    ends: tuple[int, ...]

    @property
    def n(self) -> int:
        return self.Q.shape[1]

    @cached_property
    def s(self) -> Complex:
        return 1j * self.omega

    @cached_property
    def E(self) -> Complex:
        """(F, e) the columns of the ends."""
        return ne.ends_of(self.s, self.w, self.ends)

    @cached_property
    def turns(self) -> Complex:
        return ne.turned(self.s)


def equation_of(data: Spectra, maps: Maps, F: int) -> Equation:
    """In the first F bins; zero frequency is left out where the motion is an integral of what is measured."""
    first, ends = 1 if maps.power else 0, tuple(range(2, -1 - maps.power, -1))
    omega = data.omega[first:F]
    Q = (data.Y[first:F] @ np.linalg.pinv(maps.C).T) / ((1j * omega) ** maps.power)[:, None]
    force = (data.U[first:F] * hold_spectrum(omega, data.h, data.hold)[:, None]) @ maps.L.T
    return Equation(omega, Q, force, data.weight[first:F], ends)
