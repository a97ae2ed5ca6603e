"""estimate -> a state space for python-control: a .py that makes it, or a .json with A, B, C, D, dt."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench.files import atomic_write, model_of, write_json
from sysid_bench.mechanics.simulate import continuous
from sysid_bench.nouns import Array, Estimate, InputError

_SCRIPT = '''\
"""State space identified by {method}: x = [q; q'], dt = 0 is continuous time. Written by sysid-bench export."""

import control
import numpy as np

{matrices}
system = control.ss(A, B, C, D, {dt})
'''


def state_space_of(
    estimate: Estimate, values: Mapping[str, Any], source: Path
) -> tuple[Array, Array, Array, Array, float]:
    """(A, B, C, D, dt) of M, D, K where there are such, else the one that a black-box method found.

    Raises InputError where there is neither.
    """
    if estimate.M is not None:
        model = model_of(estimate, values, source)
        return *continuous(model), 0.0
    if estimate.state_space is not None:
        return estimate.state_space
    raise InputError(
        f"estimate {source}: it has neither M, D, K nor a state space (status {estimate.status}); "
        "nothing to export."
    )


def write(estimate: Estimate, values: Mapping[str, Any], source: Path, path: Path) -> list[str]:
    """Write the state space, digits exact."""
    *matrices, dt = state_space_of(estimate, values, source)
    named = dict(zip("ABCD", matrices, strict=True))
    if path.suffix.lower() == ".json":
        write_json(path, {**named, "dt": dt})
    else:
        with atomic_write(path, "w") as file:
            file.write(_script(named, dt, str(values.get("method"))))
    return ["standard errors, and M, D, K as such (the state space holds M\\K and M\\D)"]


def _script(named: Mapping[str, Array], dt: float, method: str) -> str:
    lines = []
    for name, value in named.items():
        rows = ",\n".join(f"    {[float(x) for x in row]}" for row in np.atleast_2d(value))
        lines.append(f"{name} = np.array([\n{rows},\n])")
    return _SCRIPT.format(method=method.replace('"', "'"), matrices="\n".join(lines), dt=dt)
