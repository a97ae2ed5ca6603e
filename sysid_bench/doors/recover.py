"""recover: a clean MCAP of all that a cut-off one still holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sysid_bench.doors.measure import told
from sysid_bench.files.disk import existing_file
from sysid_bench.measure.finish import rewrite


def main(cfg: dict[str, Any]) -> int:
    """0 with a clean file. Raises InputError where nothing is readable."""
    path = existing_file(cfg["path"], "path")
    out = Path(cfg["out"]) if cfg["out"] else path.with_suffix(".recovered.mcap")
    found, verdict = rewrite(path, out, {"recovered_from": str(path)})
    state = f"cut off ({found.broken})" if found.broken else "whole"
    samples = f", {len(found.columns['k'])} samples of the record" if found.columns else ""
    print(f"{path} is {state}: {found.messages} messages{samples} -> {out}")
    if verdict is not None:
        print(told(verdict))
    return 0
