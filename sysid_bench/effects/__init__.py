"""The shelf of effects: one file each. `effect(name, dof, parameters)` makes one by its name."""

from __future__ import annotations

import importlib
import importlib.util
import pkgutil
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from sysid_bench.mechanics.effect import Effect
from sysid_bench.nouns import InputError


def names() -> list[str]:
    """Every effect of the shelf, in alphabetical order."""
    return sorted(m.name for m in pkgutil.iter_modules(__path__))


@lru_cache
def effect_class(name: str) -> type[Effect]:
    """The class of one effect. Raises InputError with the list of known ones."""
    if name not in names():
        raise InputError(
            f"no effect is called {name!r}; there are {', '.join(names())}. One of your own needs effects_path=FILE."
        )
    return _class_of(importlib.import_module(f"{__name__}.{name}"), name)


def _class_of(module, where: str) -> type[Effect]:
    found = [
        item
        for item in vars(module).values()
        if isinstance(item, type) and issubclass(item, Effect) and item.__module__ == module.__name__
    ]
    if len(found) != 1:
        raise InputError(f"{where} must hold exactly one Effect class; it holds {len(found)}.")
    return found[0]


def effect(
    name: str, dof: Any = 0, parameters: Mapping[str, Any] | None = None, kinds: Mapping = {}
) -> Effect:
    """One effect from its entry in a model file: parameters are numbers, or {"value": x, "unit": "N"}.

    `kinds`: classes of the user's own by name. Raises InputError for unknown names, parameters and units.
    """
    kind = kinds.get(name) or effect_class(name)
    given = {}
    for key, entry in (parameters or {}).items():
        if key not in kind.knobs:
            known = ", ".join(kind.knobs) or "none"
            raise InputError(f"{name} has no parameter {key!r}; it has {known}.")
        value, unit = (entry.get("value"), entry.get("unit")) if isinstance(entry, Mapping) else (entry, None)
        if unit is not None and unit != kind.knobs[key].unit:
            raise InputError(f"{name}.{key} is in {kind.knobs[key].unit!r}; got {unit!r}.")
        given[key] = _value(value, f"{name}.{key}")
    return kind(dof=tuple(dof) if isinstance(dof, list) else dof, **given)


def _value(value: Any, name: str) -> float | str:
    if isinstance(value, str):
        return value
    try:
        return float(value)
    except TypeError:
        raise InputError(f"{name} must be a number, or have one as its value; got {value!r:.60}.") from None


def own_effects(path: str | Path | None) -> tuple[type[Effect], ...]:
    """The classes that effects_path= brings: one, or none where it is not given."""
    return (own_effect(path),) if path else ()


def own_effect(path: str | Path) -> type[Effect]:
    """The Effect class in a file of the user's own. Raises InputError where there is none."""
    path = Path(path)
    if not path.is_file():
        raise InputError(
            f"effects_path must name a Python file with one Effect class; {path} does not exist."
        )
    spec = importlib.util.spec_from_file_location(f"own_effect_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise InputError(f"effects_path must name a Python file, suffix .py; got {path}.")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return _class_of(module, str(path))
