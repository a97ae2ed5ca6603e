"""a verb's config -> a refusal where a knob is of another kind than in the verb's own file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from sysid_bench.knobs import fits, said
from sysid_bench.nouns import InputError

MAY_BE_NULL = frozenset({"stuck_s"})
WHERE_NULL: Mapping[str, type] = {
    "seconds": float,
    "seed": int,
    "port": int,
    "effects": str,
}  # what a null stands for


def check_kinds(given: Mapping[str, Any], usual: Mapping[str, Any], above: str = "") -> None:
    """Raises InputError for a value of another kind than the usual one, an infinite number, an option that is none.

    A knob that is usually null and not in WHERE_NULL may be anything: its verb looks at it.
    """
    for key, value in usual.items():
        if key == "defaults":
            if "axes" not in usual:  # of a study: axes and cases name options too, the plan looks at them
                _check_options(given, value)
        elif given[key] is not None or not (value is None or key in MAY_BE_NULL):
            kind = Mapping if isinstance(value, dict) else type(value)
            _check(given[key], WHERE_NULL.get(key, object) if value is None else kind, value, above + key)
            if isinstance(value, dict) and "_target_" not in value:  # else `build` looks at it
                check_kinds(given[key], value, f"{above}{key}.")


def _check_options(given: Mapping[str, Any], defaults: list[Any]) -> None:
    for group, name in (pair for entry in defaults if isinstance(entry, dict) for pair in entry.items()):
        node = given.get(group)
        if name is not None and not (isinstance(node, Mapping) and "_target_" in node):
            raise InputError(f"{group}= wants the name of one option, for instance {group}={name}.")


def _check(given: Any, kind: type, usual: Any, name: str) -> None:
    usually = "" if usual in (None, "???") else f", usually {usual!r:.60}"
    if not fits(given, kind):
        raise InputError(f"{name} must be {said(kind)}{usually}; got {given!r:.60}.")
    if kind is float and not math.isfinite(given):
        raise InputError(f"{name} must be a finite number{usually}; got {given!r}.")
