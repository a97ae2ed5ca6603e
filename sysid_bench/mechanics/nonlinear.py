"""plant or model with effects, sampled input and its hold -> motion. The simulation of everything that is not linear.

Promise: with `substeps` small steps per sample the linear part is exact for zoh and foh inputs, and the effects'
forces are second-order accurate in h / substeps (tests/test_nonlinear.py holds this against DOP853 and Radau).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from sysid_bench.mechanics import stepping
from sysid_bench.mechanics.effect import Effect, as_effects, direction, law_tapes
from sysid_bench.mechanics.stages import stage_values
from sysid_bench.mechanics.tape import join
from sysid_bench.nouns import Array, Diverged, Model, Plant


@dataclass(frozen=True, eq=False)
class Motion:
    """q, v, a (N, n) displacement, velocity, acceleration of the model's own DOFs; y (N, ny) what is measured."""

    q: Array
    v: Array
    a: Array
    y: Array


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


@dataclass(frozen=True, eq=False)
class Step:
    """Exact propagation over one small step of h seconds: x1 = Ad x0 + force response.

    start, middle, end (nx, n): a force on each DOF that is quadratic through its values there;
    falling, rising (nx, n): a force that runs linearly from 1 to 0, from 0 to 1
    """

    Ad: Array
    start: Array
    middle: Array
    end: Array
    falling: Array
    rising: Array
    inverse_mass: Array


def matrix_exponential(A: Array) -> Array:
    """exp(A) by scaling and squaring of its Taylor series (order 16, scaled norm below 1/2)."""
    scale = max(0, int(np.ceil(np.log2(max(np.linalg.norm(A, 1), 1e-300)))) + 1)
    A = A / 2.0**scale
    total = term = np.eye(len(A))
    for k in range(1, 17):
        term = term @ A / k
        total = total + term
    for _ in range(scale):
        total = total @ total
    return total


def exact_step(M: Array, D: Array, K: Array, h: float) -> Step:
    """Propagation over h with polynomial forces (Van Loan 1978: one exponential of the augmented matrix)."""
    n = len(M)
    inverse = np.linalg.inv(M)
    big = np.zeros((5 * n, 5 * n))
    big[:n, n : 2 * n] = np.eye(n)
    big[n : 2 * n, :n], big[n : 2 * n, n : 2 * n] = -inverse @ K, -inverse @ D
    big[n : 2 * n, 2 * n : 3 * n] = inverse
    big[2 * n : 3 * n, 3 * n : 4 * n] = np.eye(n) / h  # time counted in steps: tau in [0, 1]
    big[3 * n : 4 * n, 4 * n :] = np.eye(n) / h
    E = matrix_exponential(big * h)[: 2 * n]
    B0, B1, B2 = E[:, 2 * n : 3 * n], E[:, 3 * n : 4 * n], 2 * E[:, 4 * n :]  # responses to 1, tau, tau^2
    return Step(
        E[:, : 2 * n],
        B0 - 3 * B1 + 2 * B2,
        4 * (B1 - B2),
        2 * B2 - B1,
        B0 - B1,
        B1,
        inverse,
    )


@dataclass(frozen=True, eq=False)
class Laws:
    """The force effects' tapes and parameters, as the compiled loops read them."""

    value: tuple
    slopes: tuple
    p: Array
    spans: np.ndarray  # (ne, 4): first and last parameter, first and last state
    work: int
    results: int

    @property
    def nz(self) -> int:
        return int(self.spans[-1, 3]) if len(self.spans) else 0


@lru_cache(maxsize=512)
def _joined(kinds: tuple) -> tuple:
    pairs = [law_tapes(effect) for effect in kinds]
    value, slopes = join([a for a, _, _ in pairs]), join([b for _, b, _ in pairs])
    return value[:3], slopes[:3], max(value[3], slopes[3]), max([b.outputs for _, b, _ in pairs] + [4])


def laws_of(forces: tuple[Effect, ...]) -> Laws:
    """Tapes of the force effects, joined."""
    value, slopes, work, results = _joined(tuple(forces))
    values = [e.values for e in forces]
    spans, p_at, z_at = [], 0, 0
    for e, v in zip(forces, values):
        spans.append([p_at, p_at + len(v), z_at, z_at + e.states])
        p_at, z_at = p_at + len(v), z_at + e.states
    p = np.concatenate([*values, np.zeros(0)])
    return Laws(value, slopes, p, np.array(spans, dtype=np.int64).reshape(-1, 4), work, results)


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The small steps of one simulation: X (S+1, nx), F (S+1, ne) forces, Z (S+1, nz), stage inputs (S, 3, n) in N."""

    assembly: Assembly
    step: Step
    laws: Laws
    X: Array
    F: Array
    Z: Array
    stages: Array
    h: float
    substeps: int
    t0: float = 0.0

    def accelerations(self) -> Array:
        """(S, 2, n) at the start and the end of every small step."""
        n, A = self.assembly.n, self.assembly
        rest = self.X[:, n:] @ A.D.T + self.X[:, :n] @ A.K.T + self.F @ A.directions
        ends = np.stack([self.stages[:, 0] - rest[:-1], self.stages[:, 2] - rest[1:]], axis=1)
        return ends @ self.step.inverse_mass.T

    def motion(self) -> tuple[Array, Array, Array]:
        """q, v, a (N, n) at the samples, hidden DOFs included; a is that just after the sample."""
        n, X = self.assembly.n, self.X[:: self.substeps]
        ends = self.accelerations()
        a = np.concatenate([ends[:: self.substeps, 0], ends[-1:, 1]])
        return X[:, :n], X[:, n:], a


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
    force = actuated(A, stages, small) @ A.L.T
    if pushed is not None:
        force[:, :, : A.n_own] += pushed
    W = force[:, 0] @ step.start.T + force[:, 1] @ step.middle.T + force[:, 2] @ step.end.T
    x0 = np.zeros(2 * A.n) if x0 is None else hidden_start(A, x0)
    z0 = initial_states(A.forces, A.directions, x0[: A.n])
    S, ne = len(W), len(A.forces)
    X, F, Z = np.empty((S + 1, 2 * A.n)), np.zeros((S + 1, ne)), np.zeros((S + 1, laws.nz))
    G0, G1 = A.directions @ step.falling.T, A.directions @ step.rising.T
    stepping.run(
        step.Ad, W, G0, G1, A.directions, x0, z0, laws.value, laws.p, laws.spans, laws.work, laws.results,
        t0, small, X, F, Z,
    )  # fmt: skip
    return Trajectory(A, step, laws, X, F, Z, force, small, substeps, t0)


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


def simulate(
    plant: Plant | Model,
    u: Array,
    h: float,
    hold: str,
    *,
    x0: Array | None = None,
    substeps: int = 8,
    period: int | None = None,
    series=None,
    t0: float = 0.0,
) -> Motion:
    """Motion of a plant with any effects on a sampled input u (N, nu). x0 (2 n,): q and q' at the first sample.

    Raises Diverged where the motion leaves every bound, InputError for a place outside the plant.
    """
    assembly = assemble(plant)
    for effect in assembly.actuators:
        hold = getattr(effect, "hold", hold)
    stages = stage_values(u, h, hold, substeps, series, period)
    run = trajectory(assembly, stages, h, substeps, x0, t0)
    if not np.isfinite(run.X[-1]).all():
        k = int(np.argmax(~np.isfinite(run.X).all(axis=1))) // substeps
        raise Diverged(f"the simulated motion leaves every bound at sample {k} (t = {t0 + k * h:g} s)")
    q, v, a = run.motion()
    y = measured(assembly, plant.output, q, v, a, t0 + np.arange(len(u)) * h)
    own = assembly.n_own
    return Motion(q[:, :own], v[:, :own], a[:, :own], y)


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
            s.Ad, W, *self._arms, A.directions, self.x, self._z, laws.value, laws.p, laws.spans, laws.work,
            laws.results, self.t, self._small, X, F, Z,
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
