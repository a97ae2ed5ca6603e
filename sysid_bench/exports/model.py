"""estimate -> model.yaml."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sysid_bench.files import model_of, sha256, write_model
from sysid_bench.nouns import Estimate


def write(estimate: Estimate, values: Mapping[str, Any], source: Path, path: Path) -> list[str]:
    """Write the model; `simulate`, `identify` and `gap` read it."""
    origin = {"method": values.get("method"), "inputs": {str(source): sha256(source)}}
    write_model(model_of(estimate, values, source), path, origin)
    return ["standard errors, coefficients and state space (model.yaml holds values only)"]
