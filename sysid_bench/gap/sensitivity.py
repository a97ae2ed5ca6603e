"""trajectory -> its derivatives with respect to M, D, K, effect parameters and the start, all at once and exact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.tangents import tangents
from sysid_bench.mechanics.trajectory import Trajectory
from sysid_bench.nouns import Array


@dataclass(frozen=True, eq=False)
class Variables:
    """One row per variable: kind 0 mass, 1 damping, 2 stiffness entry (row, column); 3 effect parameter; 4 start."""

    kind: np.ndarray
    row: np.ndarray
    column: np.ndarray

    def __len__(self) -> int:
        return len(self.kind)


def variables(
    entries: Sequence[tuple[int, int, int]] = (), parameters: Sequence[int] = (), states: Sequence[int] = ()
) -> Variables:
    """entries (matrix 0|1|2, row, column); numbers of the effects' parameters; numbers of the start's states."""
    rows = [*entries, *((3, k, 0) for k in parameters), *((4, k, 0) for k in states)]
    table = np.array(rows, dtype=np.int64).reshape(-1, 3)
    return Variables(*(np.ascontiguousarray(column) for column in table.T))


def derivatives(run: Trajectory, wanted: Variables, keep: Array) -> Array:
    """(ny, P, N): derivative of keep (ny, 2n) [q; v] at the samples with respect to each wanted variable."""
    A, step, laws = run.assembly, run.step, run.laws
    N = (len(run.X) - 1) // run.substeps + 1
    rest = [np.subtract(e.at_rest(1.0), e.at_rest(0.0)) for e in A.forces]
    follows = np.concatenate([*rest, np.zeros(0)])
    out = np.empty((len(keep), len(wanted), N))
    G0, G1 = A.directions @ step.falling.T, A.directions @ step.rising.T
    tangents(
        step.Ad, G0, G1, step.falling, step.rising, A.directions, run.X, run.Z, run.accelerations(),
        *laws.slopes.code, laws.cells(laws.slopes), laws.spans, run.t0, run.h,
        wanted.kind, wanted.row, wanted.column, follows, np.ascontiguousarray(keep, dtype=float), out,
    )  # fmt: skip
    return out
