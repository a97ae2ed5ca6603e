"""model.yaml <-> Model: structure, nominal values, effects; what `gap` writes, `simulate` and `gap` read."""

# json and yaml hand over values of any type.
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sysid_bench.files.disk import atomic_write
from sysid_bench.files.effects import effects_from, entry_of
from sysid_bench.files.yaml_text import read_yaml, yaml_text
from sysid_bench.nouns import HOLDS, OUTPUTS, InputError, Model, Plant

MATRICES = ("mass", "damping", "stiffness")
KEYS = (
    *MATRICES, "degrees_of_freedom", "input_map", "output_map", "output", "input_intersample",
    "initial_state", "sample_time", "units", "free", "effects", "origin",
)  # fmt: skip
INTERSAMPLE = {"zoh": "zoh", "foh": "foh", "smooth": "cubic", "bandlimited": "bandlimited"}
MAX_DOF = 1000
HEADER = """\
# M q'' + D q' + K q = L u + effects, y = C q (or q', q''); SI units.
# mass M, damping D, stiffness K (n x n), input_map L (n x nu), output_map C (ny x n).
"""


def read_model(path: str | os.PathLike[str], own: Sequence[type] = ()) -> Model:
    """Model of a model.yaml; own: effect classes of the user's that it may name.

    Raises InputError with the file, the line, what was wanted and the way out.
    """
    values, lines = read_yaml(path, "model")
    for key in values:
        if key not in KEYS:
            raise InputError(
                f"model {path}, line {lines.get(str(key), 1)}: unknown key {str(key)[:60]!r}; known are {', '.join(KEYS)}."
            )
    for key in values:
        try:
            _field(key, values[key], own)
        except InputError as problem:
            raise InputError(f"model {path}, line {lines[key]}: {problem}") from None
    try:
        return _model(values, own)
    except InputError as problem:
        raise InputError(f"model {path}: {problem}") from None


def plant_of(model: Model, path: str | os.PathLike[str]) -> Plant:
    """The plant that a model file describes. Raises InputError where it has no values."""
    if model.mass is None or model.damping is None or model.stiffness is None:
        raise InputError(f"model {path}: mass, damping and stiffness are wanted to simulate it; it has none.")
    return Plant(
        model.mass, model.damping, model.stiffness, input_map=model.input_map, output_map=model.output_map,
        output=model.output, effects=model.effects, units=model.units,
    )  # fmt: skip


def model_from(values: Mapping[str, Any]) -> Model:
    """Model of a mapping with model.yaml's keys (see docs/files.md). Raises InputError for an unknown key."""
    unknown = [key for key in values if key not in KEYS]
    if unknown:
        raise InputError(f"unknown key {unknown[0]!r}; known are {', '.join(KEYS)}.")
    return _model(values)


def _model(values: Mapping[str, Any], own: Sequence[type] = ()) -> Model:
    fields = dict(
        _field(key, value, own) for key, value in values.items() if key != "origin" and value is not None
    )
    missing = [name for name in MATRICES if name not in fields]
    if missing and len(missing) < 3:
        raise InputError(f"{', '.join(missing)} missing: mass, damping and stiffness are wanted together.")
    if missing and "n" not in fields:
        raise InputError(
            "mass, damping and stiffness are wanted (nested lists, SI); where nothing nominal is known, "
            "degrees_of_freedom instead."
        )
    try:
        model = Model(**fields)
        _check_places(model)
        return model
    except np.linalg.LinAlgError as problem:
        raise InputError(f"mass, damping, stiffness: {problem}; their values are out of range.") from None


def _check_places(model: Model) -> None:
    """Raises InputError where an effect sits at a DOF, input or output that the model does not have."""
    count = max(model.n or 0, model.nu, model.ny)
    for i, effect in enumerate(model.effects):
        places = effect.dof if isinstance(effect.dof, tuple) else (effect.dof or 0,)
        if max(places) >= count:
            raise InputError(f"effects[{i}]: {effect.name} at dof {max(places)}; they count 0..{count - 1}.")


def _field(key: str, value: Any, own: Sequence[type] = ()) -> tuple[str, Any]:
    """(field of Model, its value) of one key of the file."""
    if value is None:
        return key, None
    if key in MATRICES:
        return key, matrix(value, key, square=True)
    if key in ("input_map", "output_map"):
        return key, matrix(value, key)
    if key == "degrees_of_freedom":
        return "n", _count(value)
    if key == "output":
        return key, _word(key, value, OUTPUTS)
    if key == "input_intersample":
        return "hold", INTERSAMPLE[_word(key, value, tuple(INTERSAMPLE))]
    if key == "initial_state":
        return key, _word(key, value, ("at_rest", "free"))
    if key == "sample_time":
        return "sample_time_s", _positive(key, value)
    if key == "units":
        return key, _units(value)
    if key == "free":
        return key, _free(value)
    if key == "effects":
        return key, effects_from(value, own)
    return key, value


def matrix(value: Any, name: str, square: bool = False) -> np.ndarray:
    """2-D array of a nested list; a bare number stands for a 1x1 matrix.

    Raises InputError where rows differ, a value is no finite number, or a list is not nested.
    """
    if _is_number(value):
        value = [[value]]
    if not isinstance(value, list) or not value:
        raise InputError(
            f"{name} must be a nested list of numbers, e.g. [[1.0, 0.0], [0.0, 1.0]]; got {value!r:.60}."
        )
    if all(_is_number(item) for item in value):
        row, column = [value], [[item] for item in value]
        way = (
            "write it with all its rows" if square else f"write {row} for one row or {column} for one column"
        )
        raise InputError(f"{name} must be a nested list (rows of numbers); got {value!r:.60}: {way}.")
    if len(value) > MAX_DOF:
        raise InputError(f"{name} has {len(value)} rows; at most {MAX_DOF} are read.")
    for i, row in enumerate(value):
        if not isinstance(row, list) or len(row) != len(value[0]) or not row:
            raise InputError(
                f"{name}[{i}] must be a list of {len(value[0]) if isinstance(value[0], list) else 'n'} numbers; got {row!r:.60}."
            )
        for j, item in enumerate(row):
            if not _is_number(item) or not math.isfinite(item):
                raise InputError(f"{name}[{i}][{j}] must be a finite number; got {item!r:.60}.")
    if square and len(value) != len(value[0]):
        raise InputError(f"{name} must be square; got {len(value)} rows of {len(value[0])}.")
    return np.array(value, dtype=np.float64)


def _is_number(value: Any) -> bool:
    return isinstance(value, float) or (type(value) is int and abs(value) < 10**18)


def _count(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= MAX_DOF:
        raise InputError(f"degrees_of_freedom must be a whole number 1..{MAX_DOF}; got {value!r:.60}.")
    return value


def _word(key: str, value: Any, known: tuple[str, ...]) -> str:
    if value not in known:
        raise InputError(f"{key} must be one of {', '.join(known)}; got {value!r:.60}.")
    return value


def _positive(key: str, value: Any) -> float:
    if not _is_number(value) or not (math.isfinite(value) and value > 0):
        raise InputError(f"{key} must be a positive number of seconds; got {value!r:.60}.")
    return float(value)


def _units(value: Any) -> dict[str, Any]:
    if value == "SI":
        return {}
    if not isinstance(value, dict):
        raise InputError(f"units must be SI or a mapping, e.g. {{t: s, u: [N], y: [m]}}; got {value!r:.60}.")
    for key, unit in value.items():
        words = unit if isinstance(unit, list) else [unit]
        if not all(isinstance(word, str) for word in words):
            raise InputError(f"units.{key} must be a word or a list of words; got {unit!r:.60}.")
    return value


def _free(value: Any) -> dict[str, np.ndarray]:
    if not isinstance(value, dict) or not set(value) <= set(MATRICES):
        raise InputError(f"free must be a mapping with keys of {', '.join(MATRICES)}; got {value!r:.80}.")
    return {name: _mask(mask, f"free.{name}") for name, mask in value.items()}


def _mask(value: Any, name: str) -> np.ndarray:
    if isinstance(value, bool):
        value = [[value]]
    rows = (
        value if isinstance(value, list) and value and all(isinstance(row, list) for row in value) else None
    )
    good = rows is not None and all(
        len(row) == len(rows)
        and all(isinstance(x, bool) or (x in (0, 1) and isinstance(x, int)) for x in row)
        for row in rows
    )
    if not good:
        raise InputError(
            f"{name} must be rows of true and false, as many as the matrix has; got {value!r:.60}."
        )
    return np.array(value, dtype=bool)


def write_model(model: Model, path: str | os.PathLike[str], origin: Mapping[str, Any] | None = None) -> None:
    """Write what `read_model` reads back to the same Model, bit for bit; matrices as rows of numbers."""
    with atomic_write(path, "w") as file:
        file.write(HEADER + yaml_text(mapping_of(model, origin)))


def mapping_of(model: Model, origin: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """model.yaml's keys of a Model, plain values."""
    words = {hold: word for word, hold in INTERSAMPLE.items()}
    assert set(words) == set(HOLDS)
    values: dict[str, Any] = {name: getattr(model, name) for name in MATRICES}
    if not model.has_values:
        values = {"degrees_of_freedom": model.n}
    values |= {"input_map": model.input_map, "output_map": model.output_map, "output": model.output}
    values["input_intersample"] = None if model.hold is None else words[model.hold]
    values["initial_state"] = model.initial_state
    values["sample_time"] = model.sample_time_s
    values["units"] = dict(model.units) or None
    values["free"] = dict(model.free) or None
    values["effects"] = [entry_of(effect) for effect in model.effects] or None
    values["origin"] = dict(origin) if origin else None
    return {key: value for key, value in values.items() if value is not None}
