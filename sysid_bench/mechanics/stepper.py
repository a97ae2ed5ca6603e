"""plant with effects, one input at a time -> its measurement a sampling time later: for an emulated rig."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sysid_bench.mechanics import stepping
from sysid_bench.mechanics.assembly import assemble, effect_channels, hidden_start, initial_states, measured
from sysid_bench.mechanics.exact_step import exact_step
from sysid_bench.mechanics.trajectory import laws_of
from sysid_bench.nouns import Array, Diverged, Plant


@dataclass
class Stepper:
    """One sample at a time, for an emulated rig: `step(u)` holds u (nu,) for h seconds and returns y (ny,) after it.

    x (2 n,): q and q' now; at rest at zero where none is given.
    """

    plant: Plant
    h: float
    substeps: int = 8
    x: Array = field(default_factory=lambda: np.zeros(0))
    t: float = 0.0

    def __post_init__(self) -> None:
        self._assembly = A = assemble(self.plant)
        self._small = self.h / self.substeps
        self._step, self._laws = exact_step(A.M, A.D, A.K, self._small), laws_of(A.forces)
        self._arms = A.directions @ self._step.falling.T, A.directions @ self._step.rising.T
        self.x = hidden_start(A, self.x) if len(self.x) else np.zeros(2 * A.n)
        self._z = initial_states(A.forces, A.directions, self.x[: A.n])
        self._memory: list = [None] * len(A.actuators)

    def step(self, u: Array) -> Array:
        """Advance by one sampling time with u held; the measurement y (ny,) at its end. Raises Diverged."""
        A, S = self._assembly, self.substeps
        stages = np.broadcast_to(np.asarray(u, dtype=float), (S, 3, len(u)))
        for i, effect in enumerate(A.actuators):
            stages, self._memory[i] = effect.act(
                stages, self._small, effect_channels(effect, A.L), self._memory[i]
            )
        force = stages @ A.L.T
        s = self._step
        W = force[:, 0] @ s.start.T + force[:, 1] @ s.middle.T + force[:, 2] @ s.end.T
        X, F = np.empty((S + 1, 2 * A.n)), np.zeros((S + 1, len(A.forces)))
        Z, laws = np.zeros((S + 1, self._laws.nz)), self._laws
        stepping.run(
            s.Ad, W, *self._arms, A.directions, self.x, self._z, *laws.value.code, laws.cells(laws.value), laws.spans,
            self.t, self._small, X, F, Z,
        )  # fmt: skip
        if not np.isfinite(X[-1]).all():
            raise Diverged(f"the emulated motion leaves every bound at t = {self.t:g} s")
        self.x, self._z, self.t = X[-1], Z[-1], self.t + self.h
        return self.measure(force[-1, 2], F[-1])

    def measure(self, force: Array | None = None, f: Array | None = None) -> Array:
        """(ny,) what the sensors show now; force (n,) on the DOFs and f (ne,) of the effects, for accelerations."""
        A = self._assembly
        force = np.zeros(A.n) if force is None else force
        f = np.zeros(len(A.forces)) if f is None else f
        q, v = self.x[: A.n], self.x[A.n :]
        a = self._step.inverse_mass @ (force - A.D @ v - A.K @ q - f @ A.directions)
        return measured(A, self.plant.output, q[None], v[None], a[None], np.array([self.t]))[0]
