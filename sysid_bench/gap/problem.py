"""traces, model, effects -> residual rows, their Jacobian, and the best fit by free-run simulation."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from sysid_bench.gap.sensitivity import derivatives, variables
from sysid_bench.gap.traces import Trace
from sysid_bench.mechanics.effect import POSITIVE, Effect
from sysid_bench.mechanics.nonlinear import (
    Assembly,
    Trajectory,
    assemble,
    sensor_channels,
    trajectory,
)
from sysid_bench.nouns import Array, Model

MATRICES = ("mass", "damping", "stiffness")
# How far a nominal entry is believed to be off, relative: mass, damping, stiffness.
PRIOR = np.array([0.3, 0.6, 0.3])
SMOOTH = frozenset(
    "quadratic_drag cubic_stiffness quadratic_stiffness constant_force position_ripple periodic_disturbance "
    "time_varying_stiffness structural_damping".split()
)


@dataclass(frozen=True, eq=False)
class Point:
    """Where a fit stands: theta (ntheta,) relative to the nominal, effects, x0 per trace (2 n,)."""

    theta: Array
    effects: tuple[Effect, ...]
    starts: tuple[Array, ...]


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted point: residual rows (R,), what was simulated, covariance of (theta, parameters), and its cost.

    rss: sum of squared whitened rows; R: their number; moved: squared prior-weighted step of theta
    """

    point: Point
    rows: Array
    runs: tuple[Trajectory, ...]
    moved: float
    parameters: tuple[tuple[int, int], ...]
    covariance: Array | None = None
    steps: int = 0

    @property
    def rss(self) -> float:
        return float(self.rows @ self.rows)

    @property
    def rho(self) -> float:
        """Residual energy in the band over the noise floor: 1 where nothing is left."""
        return self.rss / len(self.rows)


@dataclass(frozen=True, eq=False)
class Problem:
    """The nominal model, which of its entries may move, and the traces to fit.

    entries (matrix 0|1|2, row, column); scale (ntheta,) size of each entry in SI
    """

    model: Model
    traces: tuple[Trace, ...]
    entries: tuple[tuple[int, int, int], ...]
    scale: Array

    @property
    def prior(self) -> Array:
        return PRIOR[[m for m, _, _ in self.entries]]

    @property
    def rows(self) -> int:
        return sum(2 * t.F * t.y.shape[1] for t in self.traces)

    def matrices(self, theta: Array) -> tuple[Array, Array, Array]:
        """M, D, K at theta."""
        out = [np.array(getattr(self.model, name)) for name in MATRICES]
        for value, (m, i, j), s in zip(theta, self.entries, self.scale):
            out[m][i, j] += value * s
            if i != j:
                out[m][j, i] += value * s
        return out[0], out[1], out[2]

    def at(self, theta: Array, effects: tuple[Effect, ...]) -> Model | None:
        """The model at theta, with effects; None where its mass is not positive."""
        M, D, K = self.matrices(theta)
        if np.linalg.eigvalsh(M)[0] <= 1e-6 * np.abs(M).max():
            return None
        return replace(self.model, mass=M, damping=D, stiffness=K, effects=effects)

    def nominal(self) -> Point:
        n = self.model.n
        return Point(
            np.zeros(len(self.entries)), self.model.effects, tuple(np.zeros(2 * n) for _ in self.traces)
        )

    def on(self, traces: tuple[Trace, ...]) -> Problem:
        """The same problem on other traces."""
        return replace(self, traces=traces)

    on_force: ClassVar[bool] = False  # True where the force is compared, not the output

    def by_log(self, effect: Effect, p: int) -> bool:
        """True where a parameter is stepped by its logarithm: those that must be positive."""
        return effect.knobs[effect.numeric[p]].range == POSITIVE

    def evaluate(self, point: Point) -> tuple[Array, tuple] | None:
        """Whitened residual rows and the runs; None where the model is inadmissible or its motion leaves every bound."""
        return _free_run(self, point)

    def jacobian(self, point: Point, runs, parameters) -> Array:
        """(R, ntheta + parameters + 2 n traces): minus the derivative of the rows; the starts come last, per trace."""
        return _free_run_jacobian(self, point, runs, parameters)


def frequency_range(model: Model, trace: Trace) -> tuple[float, float]:
    """(low, high) rad/s of the plant's own frequencies; of a free mass, from three per record to a tenth of Nyquist."""
    squared = np.abs(np.linalg.eigvals(np.linalg.solve(model.mass, model.stiffness)))
    omega = np.sqrt(squared)
    low, high = 6 * np.pi / (trace.N * trace.h), 0.1 * np.pi / trace.h
    if omega.max() < low:
        return low, high
    return max(float(omega.min()), low, 1e-3 * float(omega.max())), float(omega.max())


def problem_of(model: Model, traces: tuple[Trace, ...]) -> Problem:
    """Entries that are free: the nominal's nonzero pattern, the diagonals, damping wherever a spring is."""
    M, D, K = model.mass, model.damping, model.stiffness
    entries, scale = [], []
    for m, X in enumerate((M, D, K)):
        mask = model.free.get(MATRICES[m], np.ones_like(M, dtype=bool))
        for i in range(model.n):
            for j in range(i, model.n):
                linked = X[i, j] != 0 or (m == 1 and K[i, j] != 0)
                if mask[i, j] and (i == j or linked):
                    entries.append((m, i, j))
                    size = 0.2 * np.sqrt(abs(X[i, i] * X[j, j]))
                    scale.append(max(abs(X[i, j]), size, _natural(m, model, i, j)))
    return Problem(model, traces, tuple(entries), np.array(scale))


def _natural(m: int, model: Model, i: int, j: int) -> float:
    """A size for an entry whose nominal is zero: 2 % of critical damping; a hundredth of the stiffest spring."""
    K, M = np.abs(model.stiffness), model.mass
    if m == 0:
        return 1e-3 * M.max()
    if m == 1:
        return 0.02 * np.sqrt(max(K[i, i], 1e-3 * K.max()) * M[i, i]) + 1e-12
    return 0.01 * K.max() + 1e-12


def substeps_for(effects: tuple[Effect, ...], n: int) -> int:
    """Small steps per sample: more where a law has corners."""
    if any(e.path == "force" and e.name not in SMOOTH for e in effects):
        return 3 if n < 6 else 2
    if any(e.path in ("force", "actuator") for e in effects):
        return 2
    return 1


def hold_of(effects: tuple[Effect, ...], trace: Trace) -> str:
    return next((e.hold for e in effects if e.name == "wrong_hold"), trace.hold)


def run(problem: Problem, trace: Trace, model: Model, x0: Array) -> Trajectory:
    """Free run of one model on one trace."""
    held = trace.pull is not None  # only on the way to a free run: one step per sample will do
    substeps = 1 if held else substeps_for(model.effects, model.n)
    stages = trace.stages(substeps, hold_of(model.effects, trace))
    return trajectory(assemble(model), stages, trace.h, substeps, x0, trace.t0, trace.pulls(substeps))


def shown(problem: Problem, trace: Trace, run: Trajectory) -> Array:
    """(N, ny) what the sensors would have shown."""
    q, v, a = run.motion() if problem.model.output == "acceleration" else _states(run)
    from sysid_bench.mechanics.nonlinear import measured

    return measured(run.assembly, problem.model.output, q, v, a, trace.t)


def _states(run: Trajectory) -> tuple[Array, Array, Array]:
    n, X = run.assembly.n, run.X[:: run.substeps]
    return X[:, :n], X[:, n:], X[:, n:]


def evaluate(problem: Problem, point: Point) -> tuple[Array, tuple[Trajectory, ...]] | None:
    """See Problem.evaluate."""
    return problem.evaluate(point)


def _free_run(problem: Problem, point: Point) -> tuple[Array, tuple[Trajectory, ...]] | None:
    model = problem.at(point.theta, point.effects)
    if model is None:
        return None
    rows, runs = [], []
    for trace, x0 in zip(problem.traces, point.starts):
        one = run(problem, trace, model, x0)
        y = shown(problem, trace, one)
        if not np.isfinite(y).all() or np.abs(y).max() > 1e3 * np.abs(trace.y).max():
            return None
        rows.append(trace.rows(trace.spectrum(trace.filled(trace.y - y))))
        runs.append(one)
    return np.concatenate(rows), tuple(runs)


def keep_rows(problem: Problem, assembly: Assembly) -> Array:
    """(ny, 2 n) what is kept of the state: C q, or C v where velocity or acceleration is measured."""
    zero = np.zeros_like(assembly.C)
    position = problem.model.output == "displacement"
    return np.hstack([assembly.C, zero] if position else [zero, assembly.C])


def _free_run_jacobian(problem: Problem, point: Point, runs, parameters) -> Array:
    n, nt, blocks = problem.model.n, len(problem.entries), []
    starts = 2 * n
    for k, (trace, one) in enumerate(zip(problem.traces, runs)):
        J = _trace_jacobian(problem, point, trace, one, parameters, point.starts[k])
        block = np.zeros((len(J), nt + len(parameters) + starts * len(runs)))
        block[:, : nt + len(parameters)] = J[:, : nt + len(parameters)]
        at = nt + len(parameters) + k * starts
        block[:, at : at + starts] = J[:, nt + len(parameters) :]
        blocks.append(block)
    return np.concatenate(blocks)


def _trace_jacobian(problem: Problem, point: Point, trace: Trace, one: Trajectory, parameters, x0) -> Array:
    A, n, nt = one.assembly, problem.model.n, len(problem.entries)
    laws = [e for e in point.effects if e.path == "force"]
    offset = np.cumsum([0, *(len(e.values) for e in laws)])
    inner = [
        int(offset[laws.index(point.effects[e])]) + p
        for e, p in parameters
        if point.effects[e].path == "force"
    ]
    chain = {
        (e, p): _structure_chain(problem, point, e, p)
        for e, p in parameters
        if point.effects[e].path == "structure"
    }
    extra = [entry for entries in chain.values() for entry, _ in entries]
    states = [i if i < n else A.n + i - n for i in range(2 * n)]
    wanted = variables([*problem.entries, *extra], inner, states)
    keep = keep_rows(problem, A)
    d = derivatives(one, wanted, keep)
    sensed = np.ones((trace.N, A.C.shape[0], 1))
    for effect in A.sensors:
        if effect.name == "sensor_scale":
            sensed[:, sensor_channels(effect, A)] *= effect.factor
        if effect.name == "sensor_clipping":
            ch = sensor_channels(effect, A)
            sensed[:, ch] *= (np.abs(shown(problem, trace, one)[:, ch]) < effect.limit)[:, :, None]
    D = trace.spectrum(d * sensed)
    if problem.model.output == "acceleration":
        D = D * (1j * trace.omega)[:, None, None]
    columns = np.empty((trace.F, D.shape[1], nt + len(parameters) + 2 * n), dtype=complex)
    columns[:, :, :nt] = D[:, :, :nt] * problem.scale
    columns[:, :, nt + len(parameters) :] = D[:, :, len(wanted) - 2 * n :]
    at_extra, at_inner = nt, nt + len(extra)
    for k, (e, p) in enumerate(parameters):
        effect = point.effects[e]
        if effect.path == "force":
            columns[:, :, nt + k] = D[:, :, at_inner]
            at_inner += 1
        elif effect.path == "structure":
            total = 0
            for _, factor in chain[e, p]:
                total = total + factor * D[:, :, at_extra]
                at_extra += 1
            columns[:, :, nt + k] = total
        else:
            columns[:, :, nt + k] = _by_difference(problem, point, trace, one, e, p, x0)
    return trace.rows(columns)


def _structure_chain(
    problem: Problem, point: Point, e: int, p: int
) -> list[tuple[tuple[int, int, int], float]]:
    """Entries of the augmented M, D, K that a parameter of effect e moves, and how fast."""
    effect = point.effects[e]
    values = effect.values
    step = 1e-4 * max(abs(values[p]), 1e-6)
    both = []
    for sign in (1, -1):
        moved = effect.with_values(values + sign * step * np.eye(len(values))[p])
        effects = tuple(moved if k == e else x for k, x in enumerate(point.effects))
        A = assemble(problem.at(point.theta, effects))
        both.append((A.M, A.D, A.K))
    chain = []
    for m in range(3):
        slope = (both[0][m] - both[1][m]) / (2 * step)
        rows, cols = np.nonzero(np.triu(slope))
        chain += [((m, int(i), int(j)), float(slope[i, j])) for i, j in zip(rows, cols)]
    return chain


def _by_difference(problem: Problem, point: Point, trace: Trace, one: Trajectory, e: int, p: int, x0: Array):
    """(F, ny) derivative by a parameter of the actuator or sensor path: one more simulation, one-sided."""
    effect = point.effects[e]
    values = effect.values
    step = 1e-3 * max(abs(values[p]), _smallest(effect, trace))
    moved = effect.with_values(values + step * np.eye(len(values))[p])
    effects = tuple(moved if k == e else x for k, x in enumerate(point.effects))
    other = problem.at(point.theta, effects)
    again = run(problem, trace, other, x0) if effect.path == "actuator" else replace_assembly(one, other)
    return trace.spectrum(shown(problem, trace, again) - shown(problem, trace, one)) / step


def replace_assembly(one: Trajectory, model: Model) -> Trajectory:
    return dataclasses.replace(one, assembly=assemble(model))


def _smallest(effect: Effect, trace: Trace) -> float:
    if effect.path == "sensor":
        return 1e-2 * float(np.std(trace.y))
    return 0.1 * trace.h if effect.name in ("input_delay", "actuator_lag") else 1e-3 * float(np.std(trace.u))


def moved_point(problem: Problem, point: Point, parameters, step: Array) -> Point:
    """The point after a step in (theta, parameters, starts); parameters stay admissible, factors stay within 2."""
    nt, n = len(point.theta), problem.model.n
    values = [np.array(e.values) for e in point.effects]
    for (e, p), s in zip(parameters, step[nt:]):
        if problem.by_log(point.effects[e], p):
            values[e][p] *= np.exp(np.clip(s, -0.7, 0.7))
        else:
            values[e][p] += s
    effects = tuple(x.with_values(v) if len(v) else x for x, v in zip(point.effects, values))
    tail = step[nt + len(parameters) :].reshape(-1, 2 * n)
    return Point(point.theta + step[:nt], effects, tuple(x + s for x, s in zip(point.starts, tail)))


def free_parameters(effects: tuple[Effect, ...]) -> tuple[tuple[int, int], ...]:
    """(effect, parameter) pairs that a fit may move."""
    return tuple(
        (e, p) for e, x in enumerate(effects) for p, key in enumerate(x.numeric) if key not in x.held
    )


def fit(
    problem: Problem,
    start: Point,
    parameters: tuple[tuple[int, int], ...] = (),
    iterations: int = 12,
    tolerance: float = 3e-4,
    prior_scale: float = 1.0,
) -> Fit | None:
    """Levenberg-Marquardt on the whitened residual, theta held to the nominal by a prior.

    The prior's weight is the residual over the noise floor: trust the nominal first, the data in the end.
    parameters: (effect, parameter) pairs that are free. None where the start cannot be simulated.
    """
    found = evaluate(problem, start)
    if found is None:
        return None
    point, (rows, runs) = start, found
    nt, damping, prior = len(start.theta), 1e-4, problem.prior * prior_scale
    weight = max(1.0, rows @ rows / len(rows))
    cost = rows @ rows + weight * np.sum((point.theta / prior) ** 2)
    H, steps = None, 0
    while steps < iterations:
        steps += 1
        J_now = problem.jacobian(point, runs, parameters)
        for k, (e, p) in enumerate(parameters):
            if problem.by_log(point.effects[e], p):
                J_now[:, nt + k] *= point.effects[e].values[p]
        # J_now is d(simulated)/d(...): the rows are measured minus simulated, so H step = J' rows
        with np.errstate(over="ignore", invalid="ignore"):
            H, g = J_now.T @ J_now, J_now.T @ rows
        if not (np.isfinite(H).all() and np.isfinite(g).all()):
            break  # the derivatives of an unstable motion leave every bound
        H[np.arange(nt), np.arange(nt)] += weight * prior**-2
        g[:nt] -= weight * point.theta / prior**2
        better = None
        for _ in range(6):
            size = np.diag(H) + 1e-12 * np.max(np.diag(H)) + 1e-300
            try:
                step = np.linalg.solve(H + damping * np.diag(size), g)
            except np.linalg.LinAlgError:
                damping *= 10
                continue
            if not np.isfinite(step).all():
                damping *= 10
                continue
            trial = moved_point(problem, point, parameters, step)
            found = evaluate(problem, trial)
            if found is not None:
                new = found[0] @ found[0] + weight * np.sum((trial.theta / prior) ** 2)
                if new < cost:
                    better = trial
                    break
            damping = max(10 * damping, 1e-3)
        if better is None:
            break
        gain, point, (rows, runs) = cost - new, better, found
        damping = max(damping / 10, 1e-8)
        weight = max(1.0, rows @ rows / len(rows))
        cost = rows @ rows + weight * np.sum((point.theta / prior) ** 2)
        if gain < max(tolerance * cost, 0.5):
            break
    covariance = None
    if H is not None and np.isfinite(H).all():
        try:
            covariance = np.linalg.inv(H) * weight
        except np.linalg.LinAlgError:
            covariance = None
    moved = float(np.sum((point.theta / problem.prior) ** 2))
    return Fit(point, rows, runs, moved, tuple(parameters), covariance, steps)
