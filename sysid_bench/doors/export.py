"""estimate.json -> the file of another tool, by suffix, and what that format cannot keep."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

from sysid_bench.asked import require
from sysid_bench.files import read_estimate
from sysid_bench.nouns import InputError

FORMATS = {".yaml": "model", ".mat": "matlab", ".xml": "mjcf", ".py": "control", ".json": "control"}


def main(cfg: dict[str, Any]) -> int:
    """Write `to`; 0 where it is written."""
    require(cfg, "export", "estimate", "to")
    source, path = Path(cfg["estimate"]), Path(cfg["to"])
    name = FORMATS.get(path.suffix.lower())
    if name is None:
        raise InputError(
            f"to={path}: its name must end in {', '.join(FORMATS)}; got {path.suffix or 'no suffix'!r}."
        )
    if path.exists() and path.samefile(source):
        raise InputError(f"to={path} is the estimate itself; give another name.")
    estimate, values = read_estimate(source)
    lost = importlib.import_module(f"sysid_bench.exports.{name}").write(estimate, values, source, path)
    print(f"note: {path.suffix} does not keep: {'; '.join(lost)}", file=sys.stderr)
    print(path)
    return 0
