"""dataclass, values -> a refusal where a knob got a value of the wrong kind, by the class's own annotations."""

from __future__ import annotations

import types
from collections import abc
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from sysid_bench.nouns import InputError

_WORDS = {
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    str: "a word",
    types.NoneType: "null",
}


def check_knobs(cls: type, values: Mapping[str, Any]) -> None:
    """Raises InputError for a value that its field's annotation does not admit (numbers, words, lists of these).

    Fields with other annotations (arrays, objects) are left to the class.
    """
    for name, value in values.items():
        hint = _hints(cls).get(name, Any)
        if not fits(value, hint):
            raise InputError(f"{cls.__name__}.{name} must be {said(hint)}; got {value!r:.60}.")


@lru_cache(maxsize=512)
def _hints(cls: type) -> dict[str, Any]:
    try:
        return get_type_hints(cls)
    except (NameError, TypeError):  # an annotation that is only there for type checkers
        return {}


def fits(value: Any, hint: Any) -> bool:
    """Whether an annotation admits a value; True for annotations other than numbers, words, lists and mappings."""
    kind = get_origin(hint) or hint
    if kind in (Union, types.UnionType):
        return any(fits(value, part) for part in get_args(hint))
    if kind is Literal:
        return value in get_args(hint)
    if kind in (list, tuple):
        return isinstance(value, list | tuple) and _fits_parts(value, kind, get_args(hint))
    if kind is abc.Mapping:
        return isinstance(value, Mapping)
    if hint is float:
        return isinstance(value, int | float) and not isinstance(value, bool)
    if hint is int:
        return isinstance(value, int) and not isinstance(value, bool)
    return isinstance(value, hint) if hint in _WORDS else True


def _fits_parts(values: list[Any] | tuple[Any, ...], kind: type, parts: tuple[Any, ...]) -> bool:
    inner = [part for part in parts if part is not Ellipsis] or [Any]
    told = kind is list or len(inner) < len(parts) or not parts or len(values) == len(parts)
    return told and all(any(fits(x, part) for part in inner) for x in values)


def said(hint: Any) -> str:
    """An annotation in words."""
    kind = get_origin(hint) or hint
    if kind in (Union, types.UnionType):
        return " or ".join(said(part) for part in get_args(hint))
    if kind is Literal:
        return "one of " + ", ".join(map(str, get_args(hint)))
    if kind in (list, tuple):
        count = len(get_args(hint)) if kind is tuple and Ellipsis not in get_args(hint) else 0
        return f"a list of {count}" if count else "a list"
    if kind is abc.Mapping:
        return "a mapping"
    return _WORDS.get(hint, "something else")
