"""one entry {name, dof, parameters} of model.yaml <-> an effect of the shelf."""

# json and yaml hand over values of any type.
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false, reportUnknownVariableType=false

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sysid_bench.nouns import Effect, InputError

_ENTRY = ("name", "dof", "parameters")


def effects_from(entries: Any, own: Sequence[type] = ()) -> tuple[Effect, ...]:
    """Effects of the list `effects`; own: classes beside the shelf's. Raises InputError naming the entry that is wrong."""
    if not isinstance(entries, list):
        raise InputError(f"effects must be a list of {{name, dof, parameters}}; got {entries!r:.60}.")
    return tuple(effect_from(entry, f"effects[{i}]", own) for i, entry in enumerate(entries))


def effect_from(entry: Any, where: str, own: Sequence[type] = ()) -> Effect:
    """Effect of an entry. Raises InputError: not a mapping, unknown key, name, parameter or unit, bad place."""
    if not isinstance(entry, Mapping):
        raise InputError(f"{where} must be a mapping {{name, dof, parameters}}; got {entry!r:.60}.")
    unknown = [key for key in entry if key not in _ENTRY]
    if unknown or not isinstance(entry.get("name"), str):
        wrong = f"unknown key {unknown[0]!r}" if unknown else "its name is missing"
        raise InputError(f"{where}: {wrong}; wanted name, dof (0-based, a pair, or null) and parameters.")
    parameters = entry.get("parameters") or {}
    if not isinstance(parameters, Mapping):
        raise InputError(f"{where}.parameters must be a mapping; got {parameters!r:.60}.")
    values = {str(key): _parameter(value, f"{where}.parameters.{key}") for key, value in parameters.items()}
    return _made(entry["name"], _place(entry.get("dof"), where), values, where, own)


def _made(name: str, dof: Any, parameters: dict[str, Any], where: str, own: Sequence[type]) -> Effect:
    from sysid_bench import effects  # a shelf: looked up by name only where a file names an effect

    try:
        effect = effects.effect(name, dof, parameters, {kind.name: kind for kind in own})
        _check_words(type(effect)(), parameters)
        return effect
    except InputError as problem:
        raise InputError(f"{where}: {problem}") from None
    except (TypeError, ValueError) as problem:
        raise InputError(f"{where}: {name} cannot be made of {parameters!r:.120} ({problem}).") from None


def _check_words(default: Effect, parameters: Mapping[str, Any]) -> None:
    """A parameter is a word where its default is one, else a number."""
    for key, entry in parameters.items():
        wanted = "a word" if isinstance(getattr(default, key), str) else "a number"
        if isinstance(entry["value"], str) != (wanted == "a word"):
            raise InputError(f"{default.name}.{key} must be {wanted}; got {entry['value']!r:.40}.")


def _place(dof: Any, where: str) -> int | list[int] | None:
    numbers = dof if isinstance(dof, list) else [] if dof is None else [dof]
    whole = all(isinstance(i, int) and not isinstance(i, bool) and i >= 0 for i in numbers)
    if not whole or (isinstance(dof, list) and len(dof) != 2):
        raise InputError(f"{where}.dof must be a number 0.., a pair [i, j], or null; got {dof!r:.40}.")
    return dof


def _parameter(entry: Any, where: str) -> Any:
    """{"value", "unit"} of a parameter; a bare number is taken in SI. A `std` beside is let pass."""
    if not isinstance(entry, Mapping):
        entry = {"value": entry}
    if not set(entry) <= {"value", "unit", "std"} or "value" not in entry:
        raise InputError(f"{where} must be {{value, unit}}; got {dict(entry)!r:.80}.")
    if isinstance(entry["value"], bool) or not isinstance(entry["value"], int | float | str):
        raise InputError(f"{where}.value must be a number (or a word); got {entry['value']!r:.40}.")
    return {key: entry[key] for key in ("value", "unit") if key in entry}


def entry_of(effect: Effect) -> dict[str, Any]:
    """The entry of an effect, plain values."""
    return effect.as_dict()
