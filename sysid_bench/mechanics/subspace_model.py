"""record -> what a subspace identification of it found, in the record's own units: modes, state space, replicates."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sysid_bench.mechanics.conversion import Modes, continuous_poles, d2c
from sysid_bench.mechanics.subspace import (
    HalfModes,
    InputFit,
    check_sizes,
    default_horizon,
    fit_inputs,
    hold_drives,
    identify_modes,
    real_state_space,
)
from sysid_bench.mechanics.subspace_jackknife import replicates
from sysid_bench.nouns import Array, NotApplicable, Record

StateSpace = tuple[Array, Array, Array, Array, float]


@dataclass(frozen=True, eq=False)
class SubspaceModel:
    """Found on channels scaled to unit variance: u / su, y / sy; h in s.

    hold   zoh: the input rows of `inputs` are discrete; another: they are continuous, fitted behind that hold
    i      horizon in block rows; singular_values of the subspace step
    """

    record: Record
    su: Array
    sy: Array
    i: int
    weight: str
    hold: str
    modes: HalfModes
    singular_values: Array
    inputs: InputFit

    @property
    def z(self) -> Array:
        return _scaled(self.record, self.su, self.sy)

    @property
    def order(self) -> int:
        return int(self.modes.weight.sum())

    def discrete_form(self) -> Modes:
        """(p, c, b) with all conjugates; b discrete, so for hold zoh only."""
        p, c, b = self.modes.full(self.inputs.beta[:, :-1] / self.su)
        return p, c * self.sy[:, None], b

    def continuous_form(self, modes: HalfModes | None = None, beta: np.ndarray | None = None) -> Modes:
        """(lam, c, b), rad/s, of the estimate or of a replicate; raises Diverged where a pole has no logarithm."""
        modes, beta = self.modes if modes is None else modes, self.inputs.beta if beta is None else beta
        p, c, b = modes.full(beta[:, :-1] / self.su)
        c, h = c * self.sy[:, None], self.record.h
        if self.hold == "zoh":
            lam, b = d2c(p, b, h)
            return lam, c, b
        return continuous_poles(p, h), c, b

    def state_space(self) -> StateSpace:
        """(A, B, C, D, h), discrete behind a zoh; else continuous, h = 0: no discrete one has the same input."""
        h, zoh = self.record.h, self.hold == "zoh"
        poles = self.modes.p if zoh else continuous_poles(self.modes.p, h)
        A, B, C = real_state_space(replace(self.modes, p=poles), self.inputs.beta[:, :-1])
        through = self.inputs.feedthrough
        D = np.zeros((len(C), B.shape[1])) if through is None else through
        return A, B / self.su, C * self.sy[:, None], D * self.sy[:, None] / self.su, h if zoh else 0.0

    def drives(self, modes: HalfModes) -> np.ndarray | None:
        """What the scaled input adds to each mode per step; None behind a zoh."""
        u = self.record.u / self.su
        return None if self.hold == "zoh" else hold_drives(modes, u, self.record.h, self.hold)

    def behind(self, hold: str) -> SubspaceModel:
        """The same modes with input rows fitted behind another hold."""
        new, direct = replace(self, hold=hold), self.inputs.feedthrough is not None
        u, y = self.record.u / self.su, self.record.y / self.sy
        return replace(new, inputs=fit_inputs(self.modes, u, y, direct, new.drives(self.modes)))

    def without_blocks(self, wanted: int) -> list[tuple[HalfModes, np.ndarray] | None]:
        """(modes, beta) without each block, for continuous_form; see subspace_jackknife.replicates."""
        data = self.z, self.record.nu, self.i, self.weight
        return replicates(*data, self.modes, self.inputs, self.drives, wanted)


def _scaled(record: Record, su: Array, sy: Array) -> Array:
    return np.hstack([record.u / su, record.y / sy])


def identify(
    record: Record, i: int | None, nx: int | None, largest: int, weight: str = "moesp", direct: bool = False
) -> SubspaceModel:
    """Subspace model with zoh input rows. i None: the default horizon; nx None: order by the widest gap.

    Raises NotApplicable for constant channels, horizons too short for the order, records too short for those.
    """
    N, nu, ny = record.N, record.nu, record.ny
    i = default_horizon(N, nu, ny, nx or largest // 2) if i is None else i
    check_sizes(N, nu, ny, i, nx or largest // 2)
    su, sy = record.u.std(axis=0), record.y.std(axis=0)
    if not (np.all(su > 0) and np.all(sy > 0)):
        raise NotApplicable("a subspace method wants every input and output to vary; one is constant.")
    z = _scaled(record, su, sy)
    modes, s = identify_modes(z, nu, i, nx, weight, largest)
    inputs = fit_inputs(modes, z[:, :nu], z[:, nu:], direct)
    return SubspaceModel(record, su, sy, i, weight, "zoh", modes, s, inputs)
