"""config node -> object: follows `_target_` inside this package and packages that the user lists, nothing else."""

from __future__ import annotations

import dataclasses
import importlib
import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

from sysid_bench.knobs import check_knobs
from sysid_bench.nouns import InputError

OWN = "sysid_bench"


def build(node: Any, packages: Sequence[str] = ()) -> Any:
    """The object that a config node describes; containers are built part by part.

    A mapping with `_target_: package.module.Class` becomes Class(**rest). Raises InputError for a target
    outside `sysid_bench` and `packages`, one that is not a dataclass, and an unknown or refused knob.
    """
    if isinstance(node, Mapping):
        parts = {key: build(value, packages) for key, value in node.items() if key != "_target_"}
        return _construct(str(node["_target_"]), parts, packages) if "_target_" in node else parts
    if isinstance(node, (list, tuple)):
        return [build(value, packages) for value in node]
    return node


def target_class(target: str, packages: Sequence[str] = ()) -> type:
    """The dataclass that `target` names, after checking that its package may be followed."""
    module, _, name = target.rpartition(".")
    allowed = (OWN, *packages)
    if module.split(".")[0] not in allowed:
        raise InputError(
            f"_target_ {target!r} is refused: only classes of {', '.join(allowed)} are built from a config. "
            "List your own package with plugins=PACKAGE_OR_FOLDER."
        )
    try:
        found = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as problem:
        raise InputError(f"_target_ {target!r} names no class ({problem}).") from None
    if not (isinstance(found, type) and dataclasses.is_dataclass(found)):
        raise InputError(f"_target_ {target!r} must name a dataclass; it is a {type(found).__name__}.")
    return found


def _construct(target: str, parts: dict[str, Any], packages: Sequence[str]) -> Any:
    cls = target_class(target, packages)
    known = [f.name for f in dataclasses.fields(cls) if f.init]
    unknown = sorted(set(parts) - set(known))
    if unknown:
        raise InputError(
            f"{cls.__name__} has no knob {', '.join(map(repr, unknown))}; it has {', '.join(known) or 'none'}."
        )
    check_knobs(cls, parts)
    try:
        return cls(**parts)
    except InputError:
        raise
    except (TypeError, ValueError) as problem:
        raise InputError(f"{cls.__name__} cannot be built from {parts!r:.200}: {problem}") from problem


@lru_cache(maxsize=256)
def _build_text(text: str, packages: tuple[str, ...]) -> Any:
    return build(json.loads(text), packages)


def build_cached(text: str, packages: Sequence[str] = ()) -> Any:
    """As build, from the node's JSON text; equal texts give the one object (shelf objects are frozen)."""
    return _build_text(text, tuple(packages))
