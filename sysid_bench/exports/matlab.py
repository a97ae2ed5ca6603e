"""estimate -> MATLAB 5 .mat: M, D, K, maps, standard errors, poles, state space."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

from sysid_bench.exports.control import state_space_of
from sysid_bench.files import atomic_write
from sysid_bench.files.estimate import MATRIX_NAMES
from sysid_bench.nouns import Estimate


def write(estimate: Estimate, values: Mapping[str, Any], source: Path, path: Path) -> list[str]:
    """Write all numbers; the state space is Ass, Bss, Css, Dss, dt (dt = 0: continuous time)."""
    arrays: dict[str, Any] = {"method": str(values.get("method")), "status": estimate.status}
    for name in MATRIX_NAMES:
        arrays |= {name: getattr(estimate, name), f"{name}_std": estimate.std(name)}
    arrays |= {"covariance": estimate.covariance, "poles": estimate.poles}
    model = values.get("model") or {}
    arrays |= {"L": _array(model.get("input_map")), "C": _array(model.get("output_map"))}
    arrays["output"] = model.get("output")
    found = state_space_of(estimate, values, source)
    arrays |= dict(zip(("Ass", "Bss", "Css", "Dss", "dt"), found, strict=True))
    arrays |= {f"coefficient_{key}": value for key, value in estimate.coefficients.items()}
    with atomic_write(path) as file:
        savemat(file, {key: value for key, value in arrays.items() if value is not None}, oned_as="column")
    return ["origin and diagnostics"]


def _array(value: Any) -> np.ndarray | None:
    return None if value is None else np.array(value, dtype=np.float64)
