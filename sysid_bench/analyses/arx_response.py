"""scalar plant, T, N -> how near an identified difference equation's response comes (Kapucu and Baysec, section 7).

A record is made as in section 5 of the paper (random binary force, converter of `bits` bits), an equation of
`order` is fitted by least squares, and the fit is judged by what the conclusions speak of: terms of order above
2, the response to a new force, the response to sines up to the natural frequency.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.difference import DifferenceEquation, Orders, from_theta, regressors
from sysid_bench.mechanics.scalar import exact_equation, frequency_response, simulate
from sysid_bench.nouns import Array, InputError, Plant, Sampling


@dataclass(frozen=True)
class ArxResponse:
    """Returns relative numbers, each against the exact plant:

    residual       rms equation error over rms output
    higher_terms   largest |coefficient| of order above 2
    simulation     free-run error under a fresh force of `fresh` samples
    sine           largest error of the response to sampled-and-held sines of 0.05 .. 1 natural frequency
    sine_smooth    the same for smooth sines, of which the equation sees samples: the hold's delay included
    gain_smooth    the same, amplitudes only
    stable         1 where the fitted equation is stable

    Raises InputError on a plant that is not scalar, or fewer samples than unknowns.
    """

    order: int = 2
    amplitude_N: float = 0.5
    bits: int = 12
    range_V: float = 10.0
    fresh: int = 500

    def compute(self, plant: Plant, sampling: Sampling, rng: np.random.Generator) -> dict[str, float]:
        if sampling.N < 3 * self.order + 1:
            raise InputError(
                f"order {self.order} needs at least {3 * self.order + 1} samples; got {sampling.N}."
            )
        true, orders = exact_equation(plant, sampling.h_s), Orders(self.order, self.order + 1, 0)
        u = self._force(sampling.N, rng)
        y = self._converted(simulate(true, u))
        X, target = regressors(u, y, orders), y[orders.start :]
        theta = np.linalg.lstsq(X, target, rcond=None)[0]
        found = from_theta(theta, 1, 1, orders)
        numbers = {
            "residual": _rms(target - X @ theta) / _rms(y),
            "higher_terms": float(np.abs(np.concatenate([found.a[2:], found.b[3:], [[[0.0]]]])).max()),
            "stable": float(np.abs(np.linalg.eigvals(found.companion)).max() < 1),
            "simulation": self._simulation_error(found, true, rng),
        }
        return numbers | sine_errors(found, true, plant, sampling.h_s)

    def _force(self, N: int, rng: np.random.Generator) -> Array:
        return self.amplitude_N * rng.choice([-1.0, 1.0], (N, 1))

    def _converted(self, y: Array) -> Array:
        step = 2 * self.range_V / 2**self.bits
        return np.clip(step * np.round(y / step), -self.range_V, self.range_V - step)

    def _simulation_error(
        self, found: DifferenceEquation, true: DifferenceEquation, rng: np.random.Generator
    ) -> float:
        u = self._force(self.fresh, rng)
        y = simulate(true, u)
        with np.errstate(over="ignore", invalid="ignore"):
            return _rms(simulate(found, u) - y) / _rms(y)


def sine_errors(
    equation: DifferenceEquation, true: DifferenceEquation, plant: Plant, h: float
) -> dict[str, float]:
    """Largest relative errors of the response over 20 frequencies up to the natural one."""
    m, c, k = (float(X[0, 0]) for X in (plant.mass, plant.damping, plant.stiffness))
    omega = np.linspace(0.05, 1.0, 20) * np.sqrt(k / m)
    found, held = frequency_response(equation, omega, h), frequency_response(true, omega, h)
    smooth = 1 / (k - m * omega**2 + 1j * c * omega)
    return {
        "sine": float(np.max(np.abs(found - held) / np.abs(held))),
        "sine_smooth": float(np.max(np.abs(found - smooth) / np.abs(smooth))),
        "gain_smooth": float(np.max(np.abs(np.abs(found) / np.abs(smooth) - 1))),
    }


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(np.square(x))))
