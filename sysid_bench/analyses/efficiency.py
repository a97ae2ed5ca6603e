"""plant under a hard condition -> error of in-band maximum likelihood over the Cramer-Rao bound of that very record."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from sysid_bench.mechanics.estimation import Fit, fit_problem, problem_of
from sysid_bench.mechanics.fisher import Bound, bound_of, crlb, inverse_information
from sysid_bench.mechanics.identifiability import directions, entry_names, identifiability
from sysid_bench.mechanics.maximum import maximise
from sysid_bench.mechanics.modal import sensitivity
from sysid_bench.mechanics.second_order import ntheta, pack, undamped_modes, unpack
from sysid_bench.mechanics.simulate import simulate, steps_within
from sysid_bench.mechanics.snr import noise_variance
from sysid_bench.nouns import LOST, Array, Diverged, Plant, Record, Sampling

BURN_IN = 2000  # samples before the record for the coloured noise to settle


@dataclass(frozen=True)
class Efficiency:
    """Fits one record made for it; knows the noise spectrum for the bound only.

    knot_spacing_s   of the cubic noise force, s
    snr_db           dB, a number or one per output left
    ar               [a1, a2] of autoregressive noise, null: white
    lost_share       of output samples missing at random, 0 to 1
    sensors, forces  how many of the first sensors and forces are left; null: all
    zeta             damping ratio of every mode in place of the plant's damping; null: the plant's
    input_snr_db     dB of white noise on the measured force, which no method here models; null: none
    noise            diagonal | coloured: the noise model of the fit
    against_truth    search from the truth too

    Returns X_error and X_over_bound for X in M, D, K, worst_over_bound, fit_s, iterations, rank and condition of the
    information; against_truth: X_over_bound_from_truth, worst_over_bound_from_truth, and truth_ahead, the log-likelihood by
    which the maximum found from the truth is the higher.
    """

    knot_spacing_s: float = 1.0
    snr_db: float | list[float] = 15.0
    ar: list[float] | None = None
    lost_share: float = 0.0
    sensors: int | None = None
    forces: int | None = None
    zeta: float | None = None
    input_snr_db: float | None = None
    noise: str = "diagonal"
    against_truth: bool = False

    def compute(self, plant: Plant, sampling: Sampling, rng: np.random.Generator) -> dict[str, float]:
        """Raises Diverged where the search does not end in a maximum."""
        plant = self._changed(plant)
        record, variance = self._record(plant, sampling, rng)
        bound = self._bound(plant, record, variance)
        record = self._with_input_noise(record, rng)
        start = time.perf_counter()
        with np.errstate(all="ignore"):
            problem = problem_of([record], plant.model().structure_only(), self.noise, False, False)
            fit = fit_problem(problem, "cubic")
        seconds = time.perf_counter() - start
        if not fit.maximum.converged:
            raise Diverged("the search did not end in a maximum")
        numbers = _numbers(plant, fit.matrices, bound) | _of_search(fit) | {"fit_s": seconds}
        return numbers | (_from_truth(plant, fit, bound) if self.against_truth else {})

    def _changed(self, plant: Plant) -> Plant:
        damping = plant.damping
        if self.zeta is not None:
            omega, shapes = undamped_modes(plant.mass, plant.stiffness)
            damping = plant.mass @ shapes @ np.diag(2 * self.zeta * omega) @ shapes.T @ plant.mass
        return replace(
            plant,
            damping=(damping + damping.T) / 2,
            output_map=plant.output_map[: self.sensors],
            input_map=plant.input_map[:, : self.forces],
        )

    def _record(self, plant: Plant, sampling: Sampling, rng: np.random.Generator) -> tuple[Record, Array]:
        """Zero initial state; variance (ny,) of the noise."""
        N, h = sampling.N, sampling.h_s
        per_knot = steps_within(self.knot_spacing_s, h, "sampling.h_s", "analysis.knot_spacing_s")
        count = max(4, -(-(N - 1) // per_knot) + 1)
        u = CubicSpline(np.arange(count), rng.standard_normal((count, plant.nu)))(np.arange(N) / per_knot)
        y = simulate(plant, u, h, "cubic")
        variance = noise_variance(y, self.snr_db)
        e = rng.standard_normal((N + BURN_IN, plant.ny))
        if self.ar is not None:
            e = lfilter([1.0], [1.0, *self.ar], e, axis=0) / np.sqrt(_gain(self.ar))
        y = y + e[BURN_IN:] * np.sqrt(variance)
        quality = np.where(rng.random(N) < self.lost_share, LOST, 0).astype(np.uint8)
        return Record(h * np.arange(N), u, y, "cubic", quality if quality.any() else None), variance

    def _with_input_noise(self, record: Record, rng: np.random.Generator) -> Record:
        """The same outputs, beside forces that a noisy sensor saw."""
        if self.input_snr_db is None:
            return record
        variance = noise_variance(record.u, self.input_snr_db)
        return replace(record, u=record.u + rng.standard_normal(record.u.shape) * np.sqrt(variance))

    def _bound(self, plant: Plant, record: Record, variance: Array) -> Bound:
        if self.ar is None:
            return crlb(plant, record, variance)
        parts = (plant.mass, plant.damping, plant.stiffness, plant.input_map, plant.output_map, plant.output)
        found = sensitivity(*parts, u=record.u, h=record.h, hold="cubic")
        whitened = replace(
            found, basis=lfilter([1.0, *self.ar], [1.0], found.basis, axis=1)[:, len(self.ar) :]
        )
        information, _ = whitened.normal(None, _gain(self.ar) / variance)
        count = ntheta(plant.n)
        return bound_of(plant, inverse_information(information)[:count, :count])


def _gain(ar: list[float]) -> float:
    """Variance of the autoregressive noise over that of what drives it."""
    impulse = np.zeros(20000)
    impulse[0] = 1.0
    return float(np.sum(lfilter([1.0], [1.0, *ar], impulse) ** 2))


def _of_search(fit: Fit) -> dict[str, float]:
    told = identifiability(directions(fit.maximum.H), entry_names(fit.problem.maps.n))
    return {
        "iterations": float(fit.maximum.iterations),
        "information_rank": float(told.rank),
        "information_condition": told.condition,
    }


def _numbers(plant: Plant, found: tuple[Array, Array, Array], bound: Bound) -> dict[str, float]:
    numbers = {}
    for name, got, truth in zip("MDK", found, (plant.mass, plant.damping, plant.stiffness)):
        scale = np.linalg.norm(truth) or 1.0
        numbers[f"{name}_error"] = float(np.linalg.norm(got - truth) / scale)
        numbers[f"{name}_over_bound"] = numbers[f"{name}_error"] / getattr(bound, name)
    worst = max(value for name, value in numbers.items() if name.endswith("over_bound"))
    return numbers | {"worst_over_bound": worst}


def _from_truth(plant: Plant, fit: Fit, bound: Bound) -> dict[str, float]:
    """What the same search gives from the truth, on the same bins."""
    with np.errstate(all="ignore"):
        other = maximise(fit.runs, pack(plant.mass, plant.damping, plant.stiffness))
    numbers = _numbers(plant, unpack(other.theta, plant.n), bound)
    return {f"{k}_from_truth": v for k, v in numbers.items() if k.endswith("over_bound")} | {
        "truth_ahead": float(fit.cost - other.cost)
    }
