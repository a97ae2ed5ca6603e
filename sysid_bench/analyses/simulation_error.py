"""plant, rule, h -> error of simulating a smooth force from its samples alone (Bruschetta 2.2, 3.1, 5.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from sysid_bench.mechanics.holds import propagate
from sysid_bench.mechanics.second_order import state_space
from sysid_bench.nouns import InputError, Plant, Sampling

FINER = 4  # steps of the truth per sampling time; exact at any number


@dataclass(frozen=True)
class SimulationError:
    """White knots, interpolated cubically (section 5.1): truth on a finer grid, the rule on the samples.

    Returns error (rms of the displacement's error over its rms) and spline (largest difference between the
    force and the not-a-knot spline through its samples, relative). Noise-free. Raises InputError where the
    sampling time does not divide the knot spacing.
    """

    rule: str = "cayley"
    knot_spacing_s: float = 1.0

    def compute(self, plant: Plant, sampling: Sampling, rng: np.random.Generator) -> dict[str, float]:
        h, per_knot = sampling.h_s, round(self.knot_spacing_s / sampling.h_s)
        if per_knot < 1 or abs(per_knot * h - self.knot_spacing_s) > 1e-9 * self.knot_spacing_s:
            raise InputError(
                f"sampling.h_s = {h} must divide analysis.knot_spacing_s = {self.knot_spacing_s}."
            )
        intervals = -(-(sampling.N - 1) // per_knot)
        knots = np.arange(intervals + 1) * self.knot_spacing_s
        force = CubicSpline(knots, rng.standard_normal((len(knots), plant.nu)))
        fine = np.arange(intervals * per_knot * FINER + 1) * h / FINER
        A, B, C, _ = state_space(
            plant.mass, plant.damping, plant.stiffness, plant.input_map, plant.output_map
        )
        truth = propagate(A, B, force(fine), h / FINER, "cubic") @ C.T
        samples = force(fine)[::FINER]
        found = propagate(A, B, samples, h, self.rule) @ C.T
        between = CubicSpline(fine[::FINER], samples)(fine) - force(fine)
        return {
            "error": float(np.linalg.norm(found - truth[::FINER]) / np.linalg.norm(truth[::FINER])),
            "spline": float(np.abs(between).max() / np.abs(samples).max()),
        }
