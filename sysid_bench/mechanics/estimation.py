"""records, model -> fitted maximum likelihood -> Estimate: the course of an in-band fit, one step after another."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sysid_bench.mechanics.definite_parameters import definite_parameters, factor
from sysid_bench.mechanics.in_band import SHORTEST, Spectra, band_edge, driven, spectra, thinned
from sysid_bench.mechanics.likelihood import Point, Run, evaluate, unexplained
from sysid_bench.mechanics.maximum import LIMIT, TOLERANCE, Maximum, Parameters, maximise
from sysid_bench.mechanics.noise_weight import noise_spectrum
from sysid_bench.mechanics.proportional import proportional_parameters, proportions
from sysid_bench.mechanics.response import POWER, Maps
from sysid_bench.mechanics.samples import even_samples
from sysid_bench.mechanics.second_order import free_mask, ntheta, pack, unpack
from sysid_bench.mechanics.start import starts
from sysid_bench.mechanics.suitability import require_channels
from sysid_bench.nouns import Array, Diverged, InputError, Model, NotApplicable, Record

EDGE_OVER_TOP_MODE = 1.3  # a band that ends lower loses information
WIDEST = 2  # times the band in which the record shows a response
SHORT = 1.02  # a band that is to be wider by less is wide enough
BANDS = (1.0, 0.6, 0.35, 0.2)  # shares of the band to try in turn
ENOUGH_BINS = 500  # to approach the maximum on
NEAR = 1.0  # Newton decrement that is near enough: all bins together will gain more
NEAR_LIMIT = 30  # iterations from there; a few are the rule
SLACK = 0.05  # how negative an estimate may be by noise, relative
DIM = 0.25  # of an output's power: with more noise than this, one start is not enough
SAME_MAXIMUM = 0.1  # of log-likelihood
REWEIGHTED = 2  # times the noise spectrum is estimated anew


@dataclass(frozen=True, eq=False)
class Problem:
    """What is to be estimated from what. free (ntheta,); known (ntheta,): values of entries that are not free;
    guess (ntheta,) or None: values to start from where the records alone give no start; proportional: D = a M + b K."""

    records: tuple[Record, ...]
    maps: Maps
    free: NDArray[np.bool_]
    known: Array
    guess: Array | None
    noise: str
    definite: bool
    proportional: bool = False


@dataclass(frozen=True, eq=False)
class Fit:
    """A maximum of the likelihood, with the problem and the runs that it answers."""

    problem: Problem
    runs: list[Run]
    maximum: Maximum

    @property
    def cost(self) -> float:
        return self.maximum.cost

    @property
    def matrices(self) -> tuple[Array, Array, Array]:
        return unpack(self.maximum.theta, self.problem.maps.n)

    @cached_property
    def sound(self) -> bool:
        """The search ended, in a plant that can exist: mass and stiffness not negative, no mode that grows fast."""
        M, _, K = self.matrices
        if not (self.maximum.converged and np.all(np.isfinite(self.maximum.theta))):
            return False
        least = min(np.linalg.eigvalsh(X)[0] / np.abs(X).max() for X in (M, K))
        found = self.maximum.point.modes.poles
        return bool(least > -SLACK and np.all(found.real < SLACK * np.abs(found)))

    @cached_property
    def unexplained(self) -> float:
        return unexplained(self.maximum.point, self.runs)


def problem_of(
    records: list[Record], model: Model, noise: str, definite: bool, nominal: bool, proportional: bool = False
) -> Problem:
    """Checks that records and model belong together. Raises InputError, NotApplicable."""
    if model.effects:
        raise NotApplicable("this method is for linear models; the model has effects.")
    for record in records:
        require_channels(record, model)
    free = free_mask(model)
    if not free.all() and not model.has_values:
        raise InputError("entries that are not free need values: give mass, damping and stiffness.")
    if (definite or proportional) and not free.all():
        wish = "definite: true" if definite else "damping: proportional"
        raise InputError(f"{wish} is for matrices with all entries free; leave out the free masks.")
    known = pack(*model.matrices) if model.has_values else np.zeros(ntheta(model.n))
    maps = Maps(model.input_map, model.output_map, POWER[model.output])
    guess = known if nominal and model.has_values else None
    return Problem(tuple(records), maps, free, known, guess, noise, definite, proportional)


def fit_problem(problem: Problem, hold: str) -> Fit:
    """Maximum likelihood from the first start that leads to the noise floor, else the most likely result.

    The band is widened until it holds the top mode; where the search does not end, or ends with more in the band
    than the noise above it, it starts again on narrower bands, then from modes, then from the model's values.
    Raises NotApplicable where no start applies to the record.
    """
    runs = [in_band_run(record, problem, hold) for record in problem.records]
    tries: list[Fit] = []
    reasons: list[str] = []
    for share in BANDS:
        narrow = [_on_bins(run, max(int(share * run.F), min(run.F, SHORTEST))) for run in runs]
        near = [_thin(run) for run in narrow] if share == 1.0 else narrow
        seen: list[Array] = []
        for start in starts(near, problem.free, problem.known, problem.guess, share == 1.0):
            try:
                point = start()
                if any(np.array_equal(point.theta, other) for other in seen):
                    continue  # it would only confirm itself
                seen.append(point.theta)
                tries.append(_settled(problem, runs, *_approached(problem, near, runs, point)))
            except (Diverged, NotApplicable) as problem_met:
                reasons.append(str(problem_met))
                continue
            if tries[-1].sound and (_explained(tries[-1]) or _confirmed(tries)):
                return _coloured(tries[-1])
    if not tries:
        raise NotApplicable("no start: " + "; ".join(dict.fromkeys(reasons)))
    return _coloured(min(tries, key=lambda fit: (not fit.sound, evaluate(fit.maximum.theta, runs).cost)))


def _explained(fit: Fit) -> bool:
    """Nothing left in the band but noise, as far as the noise above the band tells; which is little where the signal is dim."""
    return fit.problem.noise != "coloured" and _dimness(fit) < DIM and fit.unexplained < 1.0


def _dimness(fit: Fit) -> float:
    """Largest share over sensors and runs of what is left in the band."""
    shares = [
        ((np.abs(fitted.R) ** 2).mean(axis=0) / run.power).max()
        for run, fitted in zip(fit.runs, fit.maximum.point.runs)
    ]
    return float(max(shares))


def _confirmed(tries: list[Fit]) -> bool:
    """Another start has led to the last maximum, and none to a higher one."""
    last, *others = reversed(tries)
    same = [fit.cost for fit in others if all(a.F == b.F for a, b in zip(fit.runs, last.runs))]
    return bool(same) and abs(min(same) - last.cost) < SAME_MAXIMUM


def _on_bins(run: Run, F: int) -> Run:
    """The run on F bins; itself, with what it has worked out already, where these are its own."""
    return run if run.F == F else replace(run, F=F)


def _thin(run: Run) -> Run:
    data, F = thinned(run.data, run.F, ENOUGH_BINS)
    return run if data is run.data else replace(run, data=data, F=F)


def _approached(
    problem: Problem, sparse: list[Run], full: list[Run], point: Point
) -> tuple[list[Run], Point, int]:
    """Runs, a start and a limit of iterations for the search on all bins: after one on few bins, where that is cheaper.

    Raises Diverged where that one ends nowhere.
    """
    if all(a.F == b.F for a, b in zip(sparse, full)):
        return full, point, LIMIT
    near = Fit(problem, sparse, _maximise(problem, sparse, point, NEAR_LIMIT, NEAR))
    if not near.sound:
        raise Diverged("the search on few bins did not end in a plant that can exist")
    runs = _widened(full, full, near.maximum)
    return runs, evaluate(near.maximum.theta, runs), NEAR_LIMIT


def _coloured(fit: Fit) -> Fit:
    """The fit reweighted by the noise spectrum of its own residual, where coloured noise was asked for."""
    if fit.problem.noise != "coloured":
        return fit
    for _ in range(REWEIGHTED):
        runs = [
            replace(run, weight=noise_spectrum(fitted.R, run.data.weight[: run.F]))
            for run, fitted in zip(fit.runs, fit.maximum.point.runs)
        ]
        fit = _searched(fit.problem, runs, fit.maximum.theta)
    return fit


def fit_hold(problem: Problem, hold: str, other: Fit) -> Fit:
    """The fit under another hold, on the same bins, from the fit under the first."""
    runs = [
        replace(run, data=_driven(_data(record, hold), run.F), weight=None)
        for run, record in zip(other.runs, problem.records)
    ]
    return _searched(problem, runs, other.maximum.theta)


def _searched(problem: Problem, runs: list[Run], theta: Array, limit: int = LIMIT) -> Fit:
    return Fit(problem, runs, _maximise(problem, runs, evaluate(theta, runs), limit))


def _data(record: Record, hold: str) -> Spectra:
    even = even_samples(record, hold)
    return replace(spectra(even.u, even.y, even.h, hold, record.period, even.mask), note=even.note)


def in_band_run(record: Record, problem: Problem, hold: str) -> Run:
    """A record on the band that carries its response. Raises NotApplicable for an output that does not move."""
    data = _data(record, hold)
    F = band_edge(data)
    noise = "full" if problem.noise == "full" else "diagonal"
    return Run(_driven(data, WIDEST * F), problem.maps, F, noise)


def _driven(data: Spectra, F: int) -> Spectra:
    return driven(data, F if data.mask is None else len(data.omega))


def _settled(problem: Problem, shown: list[Run], runs: list[Run], point: Point, limit: int) -> Fit:
    """The maximum near a start, on a band widened to hold its modes, up to twice what the record shows."""
    fit = Fit(problem, runs, _maximise(problem, runs, point, limit))
    for _ in range(2):
        wider = _widened(fit.runs, shown, fit.maximum)
        if not fit.sound or all(b.F < SHORT * a.F for a, b in zip(fit.runs, wider)):
            break
        fit = _searched(problem, wider, fit.maximum.theta, limit)
    return fit


def _widened(runs: list[Run], shown: list[Run], maximum: Maximum) -> list[Run]:
    return [
        _on_bins(run, max(run.F, min(_needed(run, maximum), WIDEST * limit.F)))
        for run, limit in zip(runs, shown)
    ]


def _needed(run: Run, maximum: Maximum) -> int:
    top = np.abs(maximum.point.modes.poles).max()
    return int(min(np.searchsorted(run.data.omega, EDGE_OVER_TOP_MODE * top), len(run.data.omega)))


def _maximise(
    problem: Problem, runs: list[Run], point: Point, limit: int = LIMIT, tolerance: float = TOLERANCE
) -> Maximum:
    free, n, theta = problem.free, problem.maps.n, point.theta
    if problem.definite:
        found = maximise(runs, theta, None, limit, tolerance, point)
        if found.converged and all(np.linalg.eigvalsh(X)[0] > 0 for X in unpack(found.theta, n)):
            return found
        return maximise(runs, factor(found.theta, n), definite_parameters(n), limit, tolerance)
    if problem.proportional:
        return maximise(runs, proportions(theta, n), proportional_parameters(n), limit, tolerance)
    if free.all():
        return maximise(runs, theta, None, limit, tolerance, point)
    T = np.eye(len(theta))[:, free]

    def value(phi: Array) -> Array:
        full = problem.known.copy()
        full[free] = phi
        return full

    return maximise(runs, theta[free], Parameters(value, lambda phi: T), limit, tolerance, point)
