"""a verb's config -> a refusal where a knob is of another kind than in the verb's own file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from sysid_bench.knobs import fits, said
from sysid_bench.nouns import InputError

MAY_BE_NULL = frozenset({"stuck_s"})


def check_kinds(given: Mapping[str, Any], usual: Mapping[str, Any], above: str = "") -> None:
    """Raises InputError for a value of another kind than the usual one, an infinite number, an option that is none.

    A knob that is usually null may be anything: its verb looks at it.
    """
    for key, value in usual.items():
        if key == "defaults":
            if "axes" not in usual:  # of a study: axes and cases name options too, the plan looks at them
                _check_options(given, value)
        elif value is not None and not (key in MAY_BE_NULL and given[key] is None):
            _check(given[key], value, above + key)


def _check_options(given: Mapping[str, Any], defaults: list[Any]) -> None:
    for group, name in (pair for entry in defaults if isinstance(entry, dict) for pair in entry.items()):
        node = given.get(group)
        if name is not None and not (isinstance(node, Mapping) and "_target_" in node):
            raise InputError(f"{group}= wants the name of one option, for instance {group}={name}.")


def _check(given: Any, usual: Any, name: str) -> None:
    kind = Mapping if isinstance(usual, dict) else type(usual)
    if not fits(given, kind):
        raise InputError(f"{name} must be {said(kind)}, usually {usual!r:.60}; got {given!r:.60}.")
    if isinstance(usual, float) and not math.isfinite(given):
        raise InputError(f"{name} must be a finite number, usually {usual!r}; got {given!r}.")
    if isinstance(usual, dict) and "_target_" not in usual:  # else `build` looks at them
        check_kinds(given, usual, f"{name}.")
