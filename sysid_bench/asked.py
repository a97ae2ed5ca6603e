"""config -> a refusal where a verb was not told what it cannot do without."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid_bench.nouns import InputError


def require(cfg: Mapping[str, Any], verb: str, *keys: str) -> None:
    """Raises InputError naming the first of `keys` that is absent, null or empty."""
    for key in keys:
        if cfg.get(key) in (None, "", [], {}):
            raise InputError(f"{verb} needs {key}=...; see `sysid-bench {verb} --help`.")
