"""White Gaussian knots, joined by a cubic spline: a smooth random force (Bruschetta 2011, section 5.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from sysid_bench.mechanics.signals import per_channel
from sysid_bench.mechanics.simulate import steps_within
from sysid_bench.nouns import Signal


@dataclass(frozen=True)
class CubicNoise:
    """knot_spacing_s: T_a of the thesis, s; content up to 0.5 / T_a Hz, which must exceed the top mode.
    rms_N: rms of the knots, N; one number or one per input

    h must divide T_a: then the spline is piecewise cubic on the sample grid and propagated exactly.
    """

    knot_spacing_s: float = 1.0
    rms_N: float | list[float] = 1.0

    def signal(self, N: int, h: float, nu: int, rng: np.random.Generator) -> Signal:
        """Raises InputError where h does not divide knot_spacing_s."""
        per_knot = steps_within(self.knot_spacing_s, h, "sampling.h_s", "excitation.knot_spacing_s")
        count = max(4, -(-(N - 1) // per_knot) + 1)
        knots = per_channel(self.rms_N, nu, "excitation.rms_N") * rng.standard_normal((count, nu))
        spline = CubicSpline(np.arange(count), knots)
        return Signal(spline(np.arange(N) / per_knot), "cubic")
