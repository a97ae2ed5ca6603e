"""assembly, stage inputs -> the small steps of one simulation: states, forces, internal states."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from sysid_bench.mechanics import stepping
from sysid_bench.mechanics.assembly import Assembly, actuated, hidden_start, initial_states
from sysid_bench.mechanics.effect import Effect, law_tapes
from sysid_bench.mechanics.exact_step import Step, exact_step
from sysid_bench.mechanics.tape import Joined, join
from sysid_bench.nouns import Array


@dataclass(frozen=True, eq=False)
class Laws:
    """The force effects' tapes and parameters, as the compiled loops read them: value gives force and states, slopes their Jacobian."""

    value: Joined
    slopes: Joined
    p: Array
    spans: np.ndarray  # (ne, 4): first and last parameter, first and last state

    @property
    def nz(self) -> int:
        return int(self.spans[-1, 3]) if len(self.spans) else 0

    def cells(self, joined: Joined) -> Array:
        """Cells for one run, parameters in their places."""
        out = joined.cells.copy()
        for law, (first, last, z_first, z_last) in zip(joined.laws, self.spans):
            at = int(law[0]) + stepping.HEAD + z_last - z_first
            out[at : at + last - first] = self.p[first:last]
        return out


@lru_cache(maxsize=512)
def _joined(kinds: tuple) -> tuple[Joined, Joined]:
    tapes = [law_tapes(effect) for effect in kinds]
    return join([value for value, _, _ in tapes]), join([slopes for _, slopes, _ in tapes])


def laws_of(forces: tuple[Effect, ...]) -> Laws:
    """Tapes of the force effects, joined."""
    value, slopes = _joined(tuple(forces))
    values = [e.values for e in forces]
    spans, p_at, z_at = [], 0, 0
    for e, v in zip(forces, values):
        spans.append([p_at, p_at + len(v), z_at, z_at + e.states])
        p_at, z_at = p_at + len(v), z_at + e.states
    p = np.concatenate([*values, np.zeros(0)])
    return Laws(value, slopes, p, np.array(spans, dtype=np.int64).reshape(-1, 4))


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The small steps of one simulation: X (S+1, nx), F (S+1, ne) forces, Z (S+1, nz).

    drive (S, 3, nu): stage inputs past the actuators; pushed (S, 3, n_own) N: further forces, None where there are none
    """

    assembly: Assembly
    step: Step
    laws: Laws
    X: Array
    F: Array
    Z: Array
    drive: Array
    pushed: Array | None
    h: float
    substeps: int
    t0: float = 0.0

    def accelerations(self) -> Array:
        """(S, 2, n) at the start and the end of every small step."""
        n, A, light = self.assembly.n, self.assembly, self.step.inverse_mass.T
        rest = self.X @ (np.hstack([A.K, A.D]).T @ light) + self.F @ (A.directions @ light)
        ends = np.empty((len(self.drive), 2, n))
        for k, (stage, left) in enumerate(((0, rest[:-1]), (2, rest[1:]))):
            np.subtract(self.drive[:, stage] @ (A.L.T @ light), left, out=ends[:, k])
            if self.pushed is not None:
                ends[:, k] += self.pushed[:, stage] @ light[: A.n_own]
        return ends

    def motion(self) -> tuple[Array, Array, Array]:
        """q, v, a (N, n) at the samples, hidden DOFs included; a is that just after the sample."""
        n, X = self.assembly.n, self.X[:: self.substeps]
        ends = self.accelerations()
        a = np.concatenate([ends[:: self.substeps, 0], ends[-1:, 1]])
        return X[:, :n], X[:, n:], a


def trajectory(
    assembly: Assembly,
    stages: Array,
    h: float,
    substeps: int,
    x0: Array | None = None,
    t0: float = 0.0,
    pushed: Array | None = None,
) -> Trajectory:
    """Run the model over stage inputs (S, 3, nu), S = (N-1) substeps, sampling time h. x0 (2 n,), zero where None.

    pushed (S, 3, n_own): further forces on each DOF, past the actuators
    """
    small = h / substeps
    A = assembly
    step = exact_step(A.M, A.D, A.K, small)
    laws = laws_of(A.forces)
    drive = actuated(A, stages, small)
    S, kinds = len(drive), (step.start.T, step.middle.T, step.end.T)
    W = drive.reshape(S, -1) @ np.concatenate([A.L.T @ one for one in kinds])
    if pushed is not None:
        W += pushed.reshape(S, -1) @ np.concatenate([one[: A.n_own] for one in kinds])
    x0 = np.zeros(2 * A.n) if x0 is None else hidden_start(A, x0)
    z0 = initial_states(A.forces, A.directions, x0[: A.n])
    ne = len(A.forces)
    X, F, Z = np.empty((S + 1, 2 * A.n)), np.zeros((S + 1, ne)), np.zeros((S + 1, laws.nz))
    G0, G1 = A.directions @ step.falling.T, A.directions @ step.rising.T
    stepping.run(
        step.Ad, W, G0, G1, A.directions, x0, z0, *laws.value.code, laws.cells(laws.value), laws.spans, t0, small,
        X, F, Z,
    )  # fmt: skip
    return Trajectory(A, step, laws, X, F, Z, drive, pushed, small, substeps, t0)
