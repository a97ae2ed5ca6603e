"""estimate, truth -> numbers. The only step that sees both the truth and the answer."""

# scipy says no types.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from sysid_bench.mechanics.conversion import zoh_coefficients
from sysid_bench.mechanics.fisher import Bound
from sysid_bench.mechanics.second_order import companion
from sysid_bench.mechanics.second_order import poles as poles_of
from sysid_bench.nouns import Array, Estimate, Plant

SCORED = ("M", "D", "K", "A", "pole")


def score(estimate: Estimate, plant: Plant, h: float, bound: Bound | None) -> dict[str, float]:
    """Columns of one row.

    X_error: ||X^ - X||_F / ||X||_F for X in M, D, K and the composed A; pole_error: ||p^ - p|| / ||p|| after
    optimal assignment; X_bound: the Cramer-Rao rms of the same number for this very record; X_over_bound their
    ratio. Difference-equation coefficients stand beside their exact values (`a1`, `a1_theory`).
    What the estimate does not give is NaN.
    """
    errors = _matrix_errors(estimate, plant)
    errors["pole"] = pole_error(estimate.poles, poles_of(plant.mass, plant.damping, plant.stiffness))
    row = {f"{name}_error": errors.get(name, np.nan) for name in SCORED} | bound_columns(bound)
    for name in SCORED:
        limit = row[f"{name}_bound"]
        row[f"{name}_over_bound"] = row[f"{name}_error"] / limit if limit > 0 else np.nan
    return row | _coefficients(estimate, plant, h)


def bound_columns(bound: Bound | None) -> dict[str, float]:
    """X_bound for every scored X: of the record, so a row has it whether or not its method gave an estimate."""
    return {f"{name}_bound": np.nan if bound is None else float(getattr(bound, name)) for name in SCORED}


def _matrix_errors(estimate: Estimate, plant: Plant) -> dict[str, float]:
    if estimate.M is None or estimate.D is None or estimate.K is None:
        return {}
    pairs = {
        "M": (estimate.M, plant.mass),
        "D": (estimate.D, plant.damping),
        "K": (estimate.K, plant.stiffness),
    }
    errors = {name: relative_error(got, truth) for name, (got, truth) in pairs.items()}
    try:
        A = companion(estimate.M, estimate.D, estimate.K)
    except np.linalg.LinAlgError:
        return errors
    return errors | {"A": relative_error(A, companion(plant.mass, plant.damping, plant.stiffness))}


def relative_error(got: Array, truth: Array) -> float:
    """||got - truth||_F / ||truth||_F; the absolute norm where the truth is zero (an undamped plant's D)."""
    scale = np.linalg.norm(truth)
    return float(np.linalg.norm(np.asarray(got) - truth) / (scale if scale > 0 else 1.0))


def pole_error(got: NDArray[Any] | None, truth: NDArray[Any]) -> float:
    """||p^ - p|| / ||p|| after optimal assignment; NaN without poles or with another number of them."""
    if got is None or len(got) != len(truth) or not np.all(np.isfinite(got)):
        return float("nan")
    distance = np.abs(np.asarray(got)[:, None] - truth[None, :]) ** 2
    rows, columns = linear_sum_assignment(distance)
    return float(np.sqrt(distance[rows, columns].sum()) / np.linalg.norm(truth))


def _coefficients(estimate: Estimate, plant: Plant, h: float) -> dict[str, float]:
    row = {name: float(value) for name, value in estimate.coefficients.items()}
    if row and plant.n == plant.nu == plant.ny == 1:
        theory: Mapping[str, float] = zoh_coefficients(
            plant.mass, plant.damping, plant.stiffness, plant.input_map, plant.output_map, h
        )
        row |= {f"{name}_theory": float(value) for name, value in theory.items()}
    return row
