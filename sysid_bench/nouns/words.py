"""The types and closed lists of words that all nouns use, and the three ways to say no."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

# Real (float64) and complex (complex128) arrays; each docstring says the shape, numpy's stubs cannot.
Array = np.ndarray[Any, Any]
Complex = np.ndarray[Any, Any]
Hold = Literal["zoh", "foh", "cubic", "bandlimited"]
Output = Literal["displacement", "velocity", "acceleration"]
Status = Literal["ok", "diverged", "timeout", "not_applicable", "error"]

HOLDS: tuple[str, ...] = ("zoh", "foh", "cubic", "bandlimited")
OUTPUTS: tuple[str, ...] = ("displacement", "velocity", "acceleration")
STATUSES: tuple[str, ...] = ("ok", "diverged", "timeout", "not_applicable", "error")

# Bits of Record.quality; 0 is a good sample.
LOST, DUPLICATED, REORDERED, CORRUPTED, LATE, CLIPPED, STUCK = 1, 2, 4, 8, 16, 32, 64
UNIFORM_STEP_RTOL = 1e-6


class InputError(ValueError):
    """The call or its input is wrong: one message (wanted, given, where, way out), exit code 2."""


class NotApplicable(Exception):
    """A method says that this record or model is outside what it can handle, with the reason."""


class Diverged(Exception):
    """A method did not reach a usable estimate, with the reason."""


def frozen_array(value: Any, name: str, ndim: int) -> Array:
    """Read-only float64 copy of `value`; refuses wrong dimension."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as problem:
        raise InputError(f"{name} must be an array of numbers; got {value!r:.80} ({problem}).") from None
    if array.ndim != ndim:
        hint = f" For one channel use {name.split('.')[-1]}[:, None]." if (ndim, array.ndim) == (2, 1) else ""
        raise InputError(f"{name} must have {ndim} dimension(s); got shape {array.shape}.{hint}")
    array.setflags(write=False)
    return array
