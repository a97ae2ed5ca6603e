"""Estimate <-> estimate.json: M, D, K with standard errors, poles, how it went, what made it."""

# json and yaml hand over values of any type.
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false, reportUnknownVariableType=false

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sysid_bench.files.disk import read_json, write_json
from sysid_bench.files.model import mapping_of, model_from
from sysid_bench.mechanics.uncertainty import uncertainty_of
from sysid_bench.nouns import STATUSES, Estimate, InputError, Model

Z95 = 1.959963984540054
MAX_COVARIANCE = 250  # parameters; a larger covariance is left out of the file
MATRIX_NAMES: tuple[Literal["M", "D", "K"], ...] = ("M", "D", "K")


def write_estimate(
    estimate: Estimate,
    path: str | os.PathLike[str],
    *,
    method: str,
    model: Model | None = None,
    origin: Mapping[str, Any] | None = None,
) -> None:
    """Write estimate.json. NaN and Inf become null.

    method  name of the method that gave it
    model   what it was handed; its maps and output are kept, so that the estimate can become a model again
    origin  resolved config, versions, hashes of the inputs
    """
    write_json(path, values_of(estimate, method, model, origin or {}))


def values_of(
    estimate: Estimate, method: str, model: Model | None, origin: Mapping[str, Any]
) -> dict[str, Any]:
    """The keys of estimate.json in their order."""
    values: dict[str, Any] = {"status": estimate.status, "reason": estimate.reason, "method": method}
    values["seconds"] = estimate.seconds
    for name in MATRIX_NAMES:
        values[name] = _matrix(estimate, name)
    values |= _poles(estimate)
    values["modes"] = _modes(estimate)
    values["coefficients"] = dict(estimate.coefficients)
    values["state_space"] = _state_space(estimate)
    values["diagnostics"] = dict(estimate.diagnostics)
    if estimate.covariance is not None and len(estimate.covariance) <= MAX_COVARIANCE:
        values["covariance"] = estimate.covariance
    if model is not None:
        values["model"] = mapping_of(model)
    values["origin"] = dict(origin)
    return values


def _matrix(estimate: Estimate, name: Literal["M", "D", "K"]) -> dict[str, Any] | None:
    value, std = getattr(estimate, name), estimate.std(name)
    return None if value is None else {"value": value, "std": std}


def _poles(estimate: Estimate) -> dict[str, Any]:
    """poles [[re, im], ...] in rad/s, omega_n (rad/s) and zeta beside, in the same order."""
    if estimate.poles is None:
        return {"poles": None, "omega_n": None, "zeta": None}
    poles = np.asarray(estimate.poles, dtype=complex)
    omega_n = np.abs(poles)
    zeta = -np.real(poles) / np.where(omega_n > 0, omega_n, np.inf)
    return {"poles": poles, "omega_n": omega_n, "zeta": zeta}


def _modes(estimate: Estimate) -> dict[str, Any] | None:
    """One entry per complex pair or real pole, with standard errors and the covariance of (omega_n, zeta)."""
    found = uncertainty_of(estimate)
    if found is None:
        return None
    names = "poles", "pole_std", "omega_n", "omega_n_std", "zeta", "zeta_std", "covariance"
    return {name: getattr(found, name) for name in names}


def _state_space(estimate: Estimate) -> dict[str, Any] | None:
    if estimate.state_space is None:
        return None
    return dict(zip(("A", "B", "C", "D", "h_s"), estimate.state_space, strict=True))


def read_estimate(path: str | os.PathLike[str]) -> tuple[Estimate, dict[str, Any]]:
    """(Estimate, all keys of the file) of an estimate.json. Raises InputError naming the key that is wrong.

    Where the file has standard errors but no covariance, the covariance is their diagonal.
    """
    values = read_json(path, "estimate")
    if not isinstance(values, dict) or values.get("status") not in STATUSES:
        raise InputError(f"estimate {path}: wanted an object with `status`, one of {', '.join(STATUSES)}.")
    matrices, stds = _matrices(values, Path(path))
    poles = _numbers(values, "poles", 2, path)
    if poles is not None and poles.shape[1:] != (2,):
        raise InputError(f"estimate {path}: poles must be pairs [re, im]; got shape {poles.shape}.")
    estimate = Estimate(
        **matrices,
        covariance=_covariance(values, stds, path),
        poles=None if poles is None else poles[:, 0] + 1j * poles[:, 1],
        state_space=_state_space_of(values, path),
        coefficients=_mapping(values, "coefficients", path),
        status=values["status"],
        reason=str(values.get("reason") or ""),
        seconds=values.get("seconds"),
        diagnostics=_mapping(values, "diagnostics", path),
    )
    return estimate, values


def model_of(estimate: Estimate, values: Mapping[str, Any], path: str | os.PathLike[str]) -> Model:
    """The model that an estimate.json says: its M, D, K with the maps and output of what was fitted.

    Raises InputError where it has no M, D, K (a black-box estimate, or a failure).
    """
    if estimate.M is None or estimate.D is None or estimate.K is None:
        raise InputError(
            f"estimate {path}: it has no M, D, K (status {estimate.status}"
            f"{': ' + estimate.reason if estimate.reason else ''}); a model needs them. "
            "Take a method that gives them, e.g. method=variational_pem."
        )
    kept = dict(values.get("model") or {})
    for key in ("degrees_of_freedom", "free"):
        kept.pop(key, None)
    matrices = {"mass": estimate.M, "damping": estimate.D, "stiffness": estimate.K}
    try:
        return model_from({**kept, **{key: value.tolist() for key, value in matrices.items()}})
    except InputError as problem:
        raise InputError(f"estimate {path}: {problem}") from None


def _matrices(values: Mapping[str, Any], path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    found, stds, n = {}, {}, None
    for name in MATRIX_NAMES:
        part = values.get(name)
        if part is not None and not isinstance(part, dict):
            raise InputError(f"estimate {path}: {name} must be {{value, std}} or null; got {part!r:.60}.")
        found[name] = _numbers(part or {}, "value", 2, path, name)
        stds[name] = _numbers(part or {}, "std", 2, path, name)
        for array in (found[name], stds[name]):
            n = n or (None if array is None else len(array))
            if array is not None and array.shape != (n, n):
                raise InputError(f"estimate {path}: {name} must hold {n}x{n} matrices; got {array.shape}.")
        if found[name] is None and stds[name] is not None:
            raise InputError(f"estimate {path}: {name} has a std but no value.")
        if found[name] is not None and not np.isfinite(found[name]).all():
            raise InputError(f"estimate {path}: {name}.value must be finite numbers.")
    return found, stds


def _numbers(
    values: Mapping[str, Any], key: str, ndim: int, path: str | os.PathLike[str], inside: str = ""
) -> np.ndarray | None:
    """Array of a nested list; null inside becomes NaN."""
    value = values.get(key)
    if value is None:
        return None
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = None
    if array is None or array.ndim != ndim or not isinstance(value, list):
        name = f"{inside}.{key}" if inside else key
        raise InputError(f"estimate {path}: {name} must be a nested list of numbers; got {value!r:.60}.")
    return array


def _covariance(
    values: Mapping[str, Any], stds: Mapping[str, Any], path: str | os.PathLike[str]
) -> np.ndarray | None:
    covariance = _numbers(values, "covariance", 2, path)
    if any(std is None for std in stds.values()):
        return covariance
    rows, cols = np.triu_indices(len(stds["M"]))
    diagonal = np.concatenate([stds[name][rows, cols] ** 2 for name in MATRIX_NAMES])
    if covariance is None:
        return np.diag(diagonal)
    if covariance.shape != (len(diagonal), len(diagonal)):
        raise InputError(
            f"estimate {path}: covariance must be {len(diagonal)} square; got {covariance.shape}."
        )
    return covariance


def _state_space_of(values: Mapping[str, Any], path: str | os.PathLike[str]) -> tuple[Any, ...] | None:
    part = values.get("state_space")
    if part is None:
        return None
    if not isinstance(part, dict) or set(part) != {"A", "B", "C", "D", "h_s"}:
        raise InputError(f"estimate {path}: state_space must have A, B, C, D and h_s; got {part!r:.60}.")
    A, B, C, D = (_numbers(part, key, 2, path, "state_space") for key in "ABCD")
    if not isinstance(part["h_s"], int | float) or any(x is None for x in (A, B, C, D)):
        raise InputError(f"estimate {path}: state_space must have A, B, C, D and h_s, all numbers.")
    return A, B, C, D, float(part["h_s"])


def _mapping(values: Mapping[str, Any], key: str, path: str | os.PathLike[str]) -> dict[str, Any]:
    part = values.get(key) or {}
    if not isinstance(part, dict):
        raise InputError(f"estimate {path}: {key} must be a mapping; got {part!r:.60}.")
    return part
