"""config, inputs -> the origin that everything written carries."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sysid_bench.files.disk import sha256
from sysid_bench.versions import origin

INTERNAL = ("plugins", "words")


def config_of(cfg: Mapping[str, Any]) -> dict[str, Any]:
    """The resolved config without what only the running process needs."""
    return {key: value for key, value in cfg.items() if key not in INTERNAL}


def provenance(verb: str, cfg: Mapping[str, Any], inputs: Sequence[str | Path] = ()) -> dict[str, Any]:
    """command, config, versions of packages and code, and the hash of every input file."""
    return {
        "command": shlex.join(["sysid-bench", verb, *cfg.get("words", [])]),
        "config": config_of(cfg),
        "inputs": {str(path): sha256(path) for path in inputs},
        **origin(),
    }
