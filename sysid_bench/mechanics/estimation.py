"""records, model -> fitted maximum likelihood -> Estimate: the course of an in-band fit, one step after another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid_bench.mechanics.in_band import SHORTEST, Spectra, band_edge, power_above, spectra
from sysid_bench.mechanics.likelihood import Maximum, Parameters, Run, maximise
from sysid_bench.mechanics.response import POWER, Maps
from sysid_bench.mechanics.second_order import free_mask, ntheta, pack, poles, unpack
from sysid_bench.mechanics.start import linear_start, refined_start
from sysid_bench.nouns import Array, Diverged, Estimate, InputError, Model, NotApplicable, Record

EDGE_OVER_TOP_MODE = 1.3  # a band that ends lower loses information
BANDS = (1.0, 0.6, 0.35, 0.2)  # shares of the band to try in turn
UNEXPLAINED = 1.5
SHORT_RECORD = 5.0  # periods of the slowest mode


@dataclass(frozen=True, eq=False)
class Problem:
    """What is to be estimated from what. free (ntheta,), known (ntheta,): values of entries that are not free."""

    records: tuple[Record, ...]
    maps: Maps
    free: NDArray[np.bool_]
    known: Array
    noise: str
    definite: bool


@dataclass(frozen=True, eq=False)
class Fit:
    problem: Problem
    runs: list[Run]
    maximum: Maximum

    @property
    def cost(self) -> float:
        return self.maximum.cost

    @property
    def matrices(self) -> tuple[Array, Array, Array]:
        return unpack(self.maximum.theta, self.problem.maps.n)


def problem_of(records: list[Record], model: Model, noise: str, definite: bool) -> Problem:
    """Checks that records and model belong together. Raises InputError, NotApplicable."""
    if model.effects:
        raise NotApplicable("this method is for linear models; the model has effects.")
    for record in records:
        if (record.nu, record.ny) != (model.nu, model.ny):
            raise InputError(
                f"the record has nu = {record.nu}, ny = {record.ny}; the model's maps want {model.nu}, {model.ny}."
            )
        if not record.is_uniform:
            raise NotApplicable("the sampling times are uneven; resample the record to a constant step.")
    free = free_mask(model)
    if not free.all() and not model.has_values:
        raise InputError("entries that are not free need values: give mass, damping and stiffness.")
    known = (
        pack(model.mass, model.damping, model.stiffness) if model.has_values else np.zeros(ntheta(model.n))
    )
    maps = Maps(model.input_map, model.output_map, POWER[model.output])
    return Problem(tuple(records), maps, free, known, noise, definite)


def fit_problem(problem: Problem, hold: str) -> Fit:
    """Maximum likelihood from the linear start, the band widened until it holds the top mode.

    Where the search does not end, or ends with more in the band than the noise above it, it starts again on
    narrower bands; the most likely result counts.
    """
    runs = [_run(record, problem, hold) for record in problem.records]
    tries: list[Fit] = []
    for share in BANDS:
        narrow = [replace(run, F=max(int(share * run.F), min(run.F, SHORTEST))) for run in runs]
        theta = refined_start(narrow, linear_start(narrow, problem.free, problem.known))
        tries.append(_settled(problem, narrow, theta))
        if tries[-1].maximum.converged and unexplained(tries[-1]) < UNEXPLAINED:
            return tries[-1]
    return min(tries, key=lambda fit: (not fit.maximum.converged, unexplained(fit)))


def unexplained(fit: Fit) -> float:
    """Largest ratio of residual power in the band to the noise above it; 1 where nothing is above it."""
    worst = 1.0
    for run, fitted in zip(fit.runs, fit.maximum.point.runs):
        above = power_above(run.data, max(run.F, len(run.data.omega) // 4))
        if above is not None and np.all(above > 0):
            worst = max(worst, float(((np.abs(fitted.R) ** 2).mean(axis=0) / above).max()))
    return worst


def fit_hold(problem: Problem, hold: str, other: Fit) -> Fit:
    """The fit under another hold, on the same bins, from the fit under the first."""
    runs = [replace(run, data=_data(record, hold)) for run, record in zip(other.runs, problem.records)]
    return Fit(problem, runs, _maximise(problem, runs, other.maximum.theta))


def _data(record: Record, hold: str) -> Spectra:
    return spectra(record.u, record.y, record.h, hold, record.period)


def _run(record: Record, problem: Problem, hold: str) -> Run:
    data = _data(record, hold)
    return Run(data, problem.maps, band_edge(data), "full" if problem.noise == "full" else "diagonal")


def _settled(problem: Problem, runs: list[Run], theta: Array) -> Fit:
    for _ in range(3):
        maximum = _maximise(problem, runs, theta)
        wider = [replace(run, F=max(run.F, _needed(run, maximum))) for run in runs]
        if all(a.F == b.F for a, b in zip(runs, wider)):
            break
        runs, theta = wider, maximum.theta
    return Fit(problem, runs, maximum)


def _needed(run: Run, maximum: Maximum) -> int:
    top = np.abs(maximum.point.modes.poles).max()
    return int(min(np.searchsorted(run.data.omega, EDGE_OVER_TOP_MODE * top), len(run.data.omega)))


def _maximise(problem: Problem, runs: list[Run], theta: Array) -> Maximum:
    free = problem.free
    if free.all():
        return maximise(runs, theta)
    T = np.eye(len(theta))[:, free]

    def value(phi: Array) -> Array:
        full = problem.known.copy()
        full[free] = phi
        return full

    return maximise(runs, theta[free], Parameters(value, lambda phi: T))


def covariance_of(fit: Fit) -> Array:
    """(ntheta, ntheta) inverse information, zero rows for entries that were not free; residual degrees of freedom."""
    free = fit.problem.free
    H = fit.maximum.H[np.ix_(free, free)]
    d = np.sqrt(np.maximum(np.diag(H), 1e-300))
    observed = sum(run.count * len(run.maps.C) for run in fit.runs)
    spent = free.sum() + 2 * fit.problem.maps.n * len(fit.runs)
    covariance = np.zeros_like(fit.maximum.H)
    inverse = np.linalg.pinv(H / np.outer(d, d), rcond=1e-14, hermitian=True) / np.outer(d, d)
    covariance[np.ix_(free, free)] = inverse * observed / max(observed - spent, 1.0)
    return covariance


def estimate_of(fit: Fit, said: Mapping[str, Any]) -> Estimate:
    """The Estimate of a fit. Raises Diverged where the search did not settle."""
    M, D, K = fit.matrices
    found = poles(M, D, K)
    if not fit.maximum.converged:
        raise Diverged(f"no maximum of the likelihood in {fit.maximum.iterations} iterations.")
    slowest = np.abs(found).min()
    periods = min(r.N * r.h for r in fit.problem.records) * slowest / (2 * np.pi)
    warnings = [str(v) for k, v in said.items() if k.endswith("warning")]
    if periods < SHORT_RECORD:
        warnings.append(
            f"the record holds {periods:.1f} periods of the slowest mode, fewer than {SHORT_RECORD:g}"
        )
    if unexplained(fit) > UNEXPLAINED:
        warnings.append(
            f"the residual in the band is {unexplained(fit):.1f} times the noise above it: coloured noise (try "
            "noise: coloured), a wrong hold, or more than a linear model"
        )
    diagnostics = {
        **{k: v for k, v in said.items() if not k.endswith("warning")},
        "iterations": fit.maximum.iterations,
        "band_rad_s": float(fit.runs[0].data.omega[fit.runs[0].F - 1]),
        "bins": fit.runs[0].F,
        "log_likelihood": -fit.cost,
        "periods": float(periods),
        "warning": "; ".join(warnings),
    }
    return Estimate(M=M, D=D, K=K, covariance=covariance_of(fit), poles=found, diagnostics=diagnostics)
