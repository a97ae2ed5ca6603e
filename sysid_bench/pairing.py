"""record, model -> the same two, checked against each other and agreed on one hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sysid_bench.nouns import UNIFORM_STEP_RTOL, InputError, Model, Record


def pair(record: Record, model: Model) -> tuple[Record, Model, list[str]]:
    """(record, model, remarks): both with the hold that will be used.

    The model's input_intersample decides, else the record's hold, else zero-order hold is assumed and a remark
    says so. Raises InputError where channels, sample time or units of the two disagree.
    """
    _check_channels(record, model)
    _check_sample_time(record, model)
    _check_units(record, model)
    hold = model.hold or record.hold or "zoh"
    return replace(record, hold=hold), replace(model, hold=hold), _remarks(record, model)


def _remarks(record: Record, model: Model) -> list[str]:
    if model.hold is None and record.hold is None:
        return [
            "neither the record nor the model says how the input runs between samples: a zero-order hold is "
            "assumed. A wrong hold biases damping and mass; say it in the model: input_intersample: zoh, foh, "
            "smooth or bandlimited."
        ]
    if model.hold and record.hold and model.hold != record.hold:
        return [
            f"the record says its input is {record.hold} between samples, the model says {model.hold}; "
            "the model's is used."
        ]
    return []


def _check_channels(record: Record, model: Model) -> None:
    if (record.nu, record.ny) != (model.nu, model.ny):
        raise InputError(
            f"the record has {record.nu} input(s) and {record.ny} output(s), the model {model.nu} and {model.ny} "
            f"({model.n} degrees of freedom). Say in the model which forces act and what is measured: "
            f"input_map ({model.n} x {record.nu}) and output_map ({record.ny} x {model.n})."
        )


def _check_sample_time(record: Record, model: Model) -> None:
    wanted = model.sample_time_s
    if wanted is None:
        return
    step = float(np.median(np.diff(record.t)))
    if abs(step - wanted) > UNIFORM_STEP_RTOL * wanted:
        raise InputError(f"the model says sample_time: {wanted:g} s, the record's step is {step:.9g} s.")


def _check_units(record: Record, model: Model) -> None:
    for key, count in (("t", 1), ("u", record.nu), ("y", record.ny)):
        ours, theirs = _listed(model.units, key, count), _listed(record.units, key, count)
        for i, (one, other) in enumerate(zip(ours, theirs, strict=False)):
            if one != other:
                name = key if key == "t" else f"{key}{i + 1}"
                raise InputError(
                    f"units of {name} disagree: {one!r} in the model, {other!r} in the record. "
                    "Convert the record to SI, or correct the one that is wrong."
                )


def _listed(units: Mapping[str, Any], key: str, count: int) -> list[str]:
    """Units of the channels; one word stands for all of them."""
    value = units.get(key) or []
    return [value] * count if isinstance(value, str) else list(value)
