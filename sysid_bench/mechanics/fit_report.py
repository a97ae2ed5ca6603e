"""a fitted maximum -> Estimate: covariance, what the record cannot tell, what to keep in mind."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid_bench.mechanics.estimation import Fit
from sysid_bench.mechanics.identifiability import (
    Identifiability,
    directions,
    drowned,
    entry_names,
    identifiability,
)
from sysid_bench.mechanics.proportional import proportional_names, proportional_parameters, proportions
from sysid_bench.mechanics.second_order import poles
from sysid_bench.nouns import Array, Diverged, Estimate

SHORT_RECORD = 5.0  # periods of the slowest mode


def tangent(fit: Fit) -> tuple[Array, list[str]]:
    """(ntheta, nphi) derivative of theta to the unknowns of the search, and their names."""
    n, free = fit.problem.maps.n, fit.problem.free
    if fit.problem.proportional:
        parameters = proportional_parameters(n)
        assert parameters.slope is not None
        return parameters.slope(proportions(fit.maximum.theta, n)), proportional_names(n)
    return np.eye(len(free))[:, free], [name for name, live in zip(entry_names(n), free) if live]


def told(fit: Fit) -> tuple[Array, Identifiability]:
    """Covariance (ntheta, ntheta): inverse information, zero rows for entries that were not free, infinite variances
    for what the record cannot tell; and the names of that."""
    T, names = tangent(fit)
    along = directions(T.T @ fit.maximum.H @ T)
    found, inverse = identifiability(along, names), along.inverse(1e-13)
    observed = sum(run.count * len(run.maps.C) for run in fit.runs)
    spent = T.shape[1] + 2 * fit.problem.maps.n * len(fit.runs)
    covariance = T @ inverse @ T.T * observed / max(observed - spent, 1.0)
    blind = np.abs(T[:, np.isin(names, found.untold)]).max(axis=1, initial=0.0) > 0
    covariance[blind, blind] = np.inf
    said = found.untold or drowned(covariance, fit.maximum.theta, fit.problem.maps.n)
    return covariance, replace(found, untold=said)


def estimate_of(fit: Fit, said: Mapping[str, Any]) -> Estimate:
    """The Estimate of a fit. Raises Diverged where the search did not settle."""
    M, D, K = fit.matrices
    if not fit.maximum.converged:
        raise Diverged(f"no maximum of the likelihood in {fit.maximum.iterations} iterations.")
    if not fit.sound:
        raise Diverged(
            "the likelihood was highest for a plant that cannot exist: too little signal for this model."
        )
    covariance, known = told(fit)
    found = poles(M, D, K)
    diagnostics = {
        **{k: v for k, v in said.items() if not k.endswith("warning")},
        "iterations": fit.maximum.iterations,
        "band_rad_s": float(fit.runs[0].data.omega[fit.runs[0].F - 1]),
        "bins": fit.runs[0].F,
        "log_likelihood": -float(fit.cost),
        "periods": _periods(fit, found),
        "information_rank": known.rank,
        "information_condition": known.condition,
        "cannot_be_told": ", ".join(known.untold),
        "warning": "; ".join(
            [*(v for k, v in said.items() if k.endswith("warning")), *_warnings(fit, known, found)]
        ),
    }
    return Estimate(M=M, D=D, K=K, covariance=covariance, poles=found, diagnostics=diagnostics)


def _periods(fit: Fit, found: NDArray[Any]) -> float:
    return float(min(r.data.N * r.data.h for r in fit.runs) * np.abs(found).min() / (2 * np.pi))


def _warnings(fit: Fit, known: Identifiability, found: NDArray[Any]) -> list[str]:
    said = [run.data.note for run in fit.runs if run.data.note]
    if _periods(fit, found) < SHORT_RECORD:
        said.append(f"the record holds {_periods(fit, found):.1f} periods of the slowest mode, fewer than 5")
    if fit.unexplained > 1:
        said.append(
            "the residual in the band is above the noise beyond it: coloured noise (try noise=coloured), a wrong "
            "hold, or more than a linear model"
        )
    nyquist = min(np.pi / r.data.h for r in fit.runs)
    if np.abs(found).max() > nyquist:
        said.append("a mode lies above the Nyquist frequency: sample faster")
    if known.untold:
        said.append(f"the record cannot tell {', '.join(known.untold)}")
    return said
