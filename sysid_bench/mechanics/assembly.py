"""model with effects -> what the loops need, sorted by what each effect acts on: structure, forces, drive, sensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.effect import Effect, as_effects, direction
from sysid_bench.nouns import Array, Model, Plant


@dataclass(frozen=True, eq=False)
class Assembly:
    """A model sorted by what its effects act on. n counts hidden DOFs too; n_own does not.

    M, D, K (n, n); L (n, nu); C (ny, n); forces: effects with a law; directions (ne, n); actuators; sensors
    """

    M: Array
    D: Array
    K: Array
    L: Array
    C: Array
    n_own: int
    forces: tuple[Effect, ...]
    directions: Array
    actuators: tuple[Effect, ...]
    sensors: tuple[Effect, ...]

    @property
    def n(self) -> int:
        return len(self.M)


def assemble(model: Model | Plant) -> Assembly:
    """Sort the effects by path; effects of the structure are built into M, D, K."""
    (M, D, K), n_own = model.matrices, model.n
    by_path: dict[str, list[Effect]] = {}
    for effect in as_effects(model.effects):
        by_path.setdefault(effect.path, []).append(effect)
    for effect in by_path.get("structure", []):
        c = np.pad(direction(effect.dof, n_own), (0, len(M) - n_own))
        M, D, K = effect.augment(M, D, K, c)
    extra = len(M) - n_own
    L = np.pad(model.input_map, ((0, extra), (0, 0)))
    C = np.pad(model.output_map, ((0, 0), (0, extra)))
    forces = tuple(by_path.get("force", []))
    directions = np.array([np.pad(direction(e.dof, n_own), (0, extra)) for e in forces]).reshape(-1, len(M))
    sensors = tuple(by_path.get("sensor", []) + by_path.get("timing", []))
    return Assembly(M, D, K, L, C, n_own, forces, directions, tuple(by_path.get("actuator", [])), sensors)


def actuated(assembly: Assembly, stages: Array, h: float) -> Array:
    """What the stage values (S, 3, nu) become on their way through the actuator effects."""
    for effect in assembly.actuators:
        stages, _ = effect.act(stages, h, effect_channels(effect, assembly.L), None)
    return stages


def effect_channels(effect: Effect, L: Array) -> list[int]:
    """Input channels that push on the effect's DOF; all channels where it has none."""
    if effect.dof is None or isinstance(effect.dof, tuple):
        return list(range(L.shape[1]))
    return [c for c in range(L.shape[1]) if L[effect.dof, c] != 0]


def initial_states(forces: tuple[Effect, ...], directions: Array, q0: Array) -> Array:
    """(nz,) internal states at rest at displacement q0."""
    parts = [np.asarray(e.at_rest(float(c @ q0)), dtype=float) for e, c in zip(forces, directions)]
    return np.concatenate([*parts, np.zeros(0)])


def hidden_start(assembly: Assembly, x0: Array) -> Array:
    """x0 (2 n_own,) of the own DOFs, completed to (2 n,): hidden masses rest on what carries them."""
    n, own = assembly.n, assembly.n_own
    if len(x0) == 2 * n:
        return np.asarray(x0, dtype=float)
    q, v = np.zeros(n), np.zeros(n)
    q[:own], v[:own] = x0[:own], x0[own:]
    K = assembly.K
    q[own:] = -np.linalg.solve(K[own:, own:], K[own:, :own] @ q[:own])
    return np.concatenate([q, v])


def measured(assembly: Assembly, output: str, q: Array, v: Array, a: Array, t: Array) -> Array:
    """(N, ny) what the sensors show, sensor and timing effects included."""
    with np.errstate(
        invalid="ignore", over="ignore"
    ):  # a motion that left every bound is refused where it is judged
        y = {"displacement": q, "velocity": v, "acceleration": a}[output] @ assembly.C.T
    for effect in assembly.sensors:
        y = effect.sense(y, t, sensor_channels(effect, assembly))
    return y


def sensor_channels(effect: Effect, assembly: Assembly) -> list[int]:
    """Output channels that see the effect's DOF; all where it has none."""
    C = assembly.C
    if effect.dof is None or isinstance(effect.dof, tuple):
        return list(range(len(C)))
    return [c for c in range(len(C)) if C[c, effect.dof] != 0]
