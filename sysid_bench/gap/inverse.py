"""measured motion, model -> the force that this motion needs: residual rows on the force, and their derivatives.

Inverse dynamics (Gautier, Poignet 2001): linear in M, D, K and in most effects, and no simulation that may drift.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid_bench.gap.descent import Fit
from sysid_bench.gap.motion import Moved, force_along
from sysid_bench.gap.problem import Point, Problem
from sysid_bench.gap.traces import Trace
from sysid_bench.mechanics.assembly import Assembly, actuated, assemble
from sysid_bench.mechanics.effect import Effect, as_effects, direction
from sysid_bench.mechanics.stages import stage_values
from sysid_bench.mechanics.trajectory import trajectory
from sysid_bench.nouns import Array, Model

ENDS = 0.04  # of a record at either end: brought to zero, and left out of the rows
FINE = 4  # steps per sample in which an input is read
PHASE = "phase"  # a parameter that every record has of its own


@dataclass(frozen=True, eq=False)
class ForceProblem(Problem):
    """A problem judged on the force. motions: what each trace measured; rows are samples in time of 2 F per trace."""

    motions: tuple[Moved, ...] = ()
    on_force = True

    def nominal(self) -> Point:
        return Point(np.zeros(len(self.entries)), self.effects, ())

    def by_log(self, effect: Effect, p: int) -> bool:
        """So is how steeply a sign is smoothed: at zero a force that jumps would have no derivative by it."""
        return effect.numeric[p] == "speed" or super().by_log(effect, p)

    def share_missed(self, fit: Fit) -> float:
        """|F - Fhat| / |F| over the traces."""
        given = [self.rows_on(k, t.u @ self.model.input_map.T) for k, t in enumerate(self.traces)]
        return float(np.linalg.norm(fit.rows) / max(np.linalg.norm(np.concatenate(given)), 1e-300))

    def forces(self, model: Model, k: int) -> tuple[Array, Array]:
        """(N, n) given and needed force on trace k."""
        A = assemble(model)
        return given_force(A, self.traces[k]), needed_force(A, self.motions[k], self.traces[k])

    def residual(self, model: Model, k: int) -> Array:
        """(N, n) given minus needed force."""
        given, needed = self.forces(model, k)
        return given - needed

    def wave(self, effect: Effect, k: int) -> Array:
        """(N, n) force of one effect along the motion of trace k."""
        return lone_force(effect, self.motions[k], self.traces[k], self.model.n)

    def kept(self, k: int) -> np.ndarray:
        """(2 F,) bool: rows of trace k away from its ends and from samples that are not good."""
        trace = self.traces[k]
        place = np.arange(2 * trace.F) / (2 * trace.F)
        kept = (place > 1.5 * ENDS) & (place < 1 - 1.5 * ENDS)
        if not trace.good.all():
            width = 2 * trace.N // trace.F + 1
            near = np.convolve(~trace.good, np.ones(2 * width + 1), "same") > 0
            kept &= ~near[(place * trace.N).astype(int)]
        return kept

    def rows_on(self, k: int, x: Array) -> Array:
        """(rows, ...) whitened rows of forces x (N, n, ...) on trace k: time first, then DOF."""
        rows = rows_of(self.traces[k], x)[self.kept(k)]
        return rows.reshape(-1, *x.shape[2:])

    def evaluate(self, point: Point) -> tuple[Array, tuple[Moved, ...]] | None:
        """Whitened residual force at a point; None where its mass is not positive."""
        model = self.at(point.theta, point.effects)
        if model is None:
            return None
        rows = []
        for k in range(len(self.traces)):
            own = model if k == 0 else replace(model, effects=own_phases(self, k, model))
            rows.append(self.rows_on(k, self.residual(own, k)))
        rows = np.concatenate(rows)
        return (rows, self.motions) if np.isfinite(rows).all() else None

    def jacobian(self, point: Point, runs: Any, parameters: Any) -> Array:
        """(R, ntheta + parameters): minus the derivative of the rows."""
        model, blocks = self.model_at(point), []
        for k in range(len(self.traces)):
            own = point.effects if k == 0 else own_phases(self, k, model)
            columns = [self.theta_forces(k), *self._slopes(k, replace(model, effects=own), parameters)]
            blocks.append(self.rows_on(k, np.concatenate(columns, axis=2)))
        return np.concatenate(blocks)

    def theta_forces(self, k: int) -> Array:
        """(N, n, ntheta) force that a unit change of each entry needs."""
        m, n = self.motions[k], self.model.n
        motion = (m.a, m.v, m.q)
        out = np.zeros((len(m.q), n, len(self.entries)))
        for column, ((which, i, j), scale) in enumerate(zip(self.entries, self.scale)):
            out[:, i, column] += scale * motion[which][:, j]
            if i != j:
                out[:, j, column] += scale * motion[which][:, i]
        return out

    def _slopes(self, k: int, model: Model, parameters: Any) -> list[Array]:
        """(N, n, 1) change of needed minus given force per parameter, by difference."""
        trace, motion, out = self.traces[k], self.motions[k], []
        for e, p in parameters:
            effect = model.effects[e]
            step = 1e-4 * max(abs(effect.values[p]), _small(effect, p, trace, motion))
            both = [
                effect.with_values(effect.values + s * step * np.eye(len(effect.values))[p]) for s in (1, -1)
            ]
            width = both[0].values[p] - both[1].values[p]
            changed = [self._share(one, e, k, model) for one in both]
            out.append(((changed[0] - changed[1]) / width)[:, :, None])
        return out

    def _share(self, effect: Effect, e: int, k: int, model: Model) -> Array:
        """(N, n) needed minus given force, as far as effect number e has a part in it."""
        if effect.path == "force":
            return self.wave(effect, k)
        effects = tuple(effect if i == e else x for i, x in enumerate(model.effects))
        return -self.residual(replace(model, effects=effects), k)


def _small(effect: Effect, p: int, trace: Trace, motion: Moved) -> float:
    """A size for a parameter that is zero."""
    unit = effect.knobs[effect.numeric[p]].unit
    sizes = {"m/s": 0.01 * motion.v.std(), "m": 0.01 * motion.q.std(), "s": 0.1 * trace.h, "rad": 1.0}
    return float(sizes.get(unit, 1e-3 * trace.u.std()))


def measured_motion(trace: Trace) -> Moved:
    """q, v, a (N, n) of measured displacements: differentiated up to twice the band, zero phase.

    An odd reflection about both ends keeps a record that does not close from ringing.
    """
    y, N = trace.filled(trace.y), trace.N
    share = np.linspace(0, 1, N)[:, None]
    line = (1 - share) * y[:1] + share * y[-1:]
    slope = (y[-1] - y[0]) / ((N - 1) * trace.h)
    d = y - line
    X = np.fft.rfft(np.concatenate([d, -d[-2:0:-1]]), axis=0)
    omega = 2 * np.pi * np.fft.rfftfreq(2 * N - 2, trace.h)[:, None]
    X = X / (1 + (omega / (2 * trace.omega[-1])) ** 8)
    q, v, a = (np.fft.irfft(X * (1j * omega) ** k, 2 * N - 2, axis=0)[:N] for k in range(3))
    return Moved(q + line, v + slope, a)


def given_force(A: Assembly, trace: Trace) -> Array:
    """(N, n) force of the inputs after the actuators, as its hold runs it, without what lies above the sampling rate."""
    stages = actuated(A, trace.stages(FINE), trace.h / FINE)
    after = np.concatenate([stages[:, 0], stages[-1:, 2]])
    before = np.concatenate([stages[:1, 0], stages[:, 2]])
    u = 0.5 * (before + after)  # ((N - 1) FINE + 1, nu)
    share = np.linspace(0, 1, len(u))[:, None]
    line = (1 - share) * u[:1] + share * u[-1:]
    fine = np.concatenate([u - line, np.zeros((FINE - 1, u.shape[1]))])
    slow = np.fft.irfft(np.fft.rfft(fine, axis=0)[: trace.N // 2 + 1], trace.N, axis=0) / FINE
    return (slow + line[::FINE]) @ A.L[: A.n_own].T


def needed_force(A: Assembly, m: Moved, trace: Trace) -> Array:
    """(N, n) force that the motion needs: M a + D v + K q and the effects' forces, hidden masses included."""
    n = A.n_own
    force = m.a @ A.M[:n, :n] + m.v @ A.D[:n, :n] + m.q @ A.K[:n, :n]
    if A.n > n:
        force = force + _hidden(A, m, trace)
    for effect in A.forces:
        force = force + lone_force(effect, m, trace, n)
    return force


def lone_force(effect: Effect, m: Moved, trace: Trace, n: int) -> Array:
    """(N, n) force of one effect along the motion."""
    c = direction(effect.dof, n)
    f = np.nan_to_num(force_along(effect, m.q @ c, m.v @ c, trace.h, trace.t0))
    return np.outer(f, c)


def _hidden(A: Assembly, m: Moved, trace: Trace) -> Array:
    """(N, n_own) what hidden masses, carried along from rest, add to the needed force."""
    n = A.n_own
    carried = -(m.a @ A.M[:n, n:] + m.v @ A.D[:n, n:] + m.q @ A.K[:n, n:])
    own = slice(n, None)
    count = A.n - n
    lone = Assembly(
        A.M[own, own], A.D[own, own], A.K[own, own], np.eye(count), np.eye(count), count, (),
        np.zeros((0, count)), (), (),
    )  # fmt: skip
    stages = stage_values(carried, trace.h, "cubic", 1)
    start = np.concatenate([np.linalg.solve(A.K[own, own], carried[0]), np.zeros(count)])
    q, v, a = trajectory(lone, stages, trace.h, 1, start).motion()
    return a @ A.M[n:, :n] + v @ A.D[n:, :n] + q @ A.K[n:, :n]


def fade(N: int) -> Array:
    """(N,) from zero to one and back within the ends of a record."""
    ends = np.minimum(np.arange(N), np.arange(N)[::-1]) / (ENDS * N)
    return np.sin(np.pi / 2 * np.minimum(ends, 1.0)) ** 2


def rows_of(trace: Trace, x: Array, keep: bool = True) -> Array:
    """(2 F, n, ...) forces x (N, n, ...) in the band, one row per half period of its end; whitened where `keep`."""
    N, F = trace.N, trace.F
    X = np.fft.rfft(x * fade(N).reshape(-1, *([1] * (x.ndim - 1))), axis=0)[:F]
    if keep:
        X = X * trace.weight.reshape(*trace.weight.shape, *([1] * (x.ndim - 2)))
    return np.fft.irfft(X, 2 * F, axis=0) * (2 * F / N)


def own_phases(problem: ForceProblem, k: int, model: Model, part: Any = slice(None)) -> tuple[Effect, ...]:
    """The model's effects with the phases that serve trace k best: an encoder that was switched off has its own.

    part: rows of the trace that may be used.
    """
    effects = list(as_effects(model.effects))
    waves = [e for e, x in enumerate(effects) if x.path == "force" and PHASE in x.numeric]
    if not waves:
        return tuple(effects)
    rest = replace(model, effects=tuple(x for e, x in enumerate(effects) if e not in waves))
    left = problem.residual(rest, k)
    columns = []
    for e in waves:
        for phase in (0.0, np.pi / 2):
            columns.append(problem.wave(replace(effects[e], **{PHASE: phase}), k))
    trace, kept = problem.traces[k], np.zeros(2 * problem.traces[k].F, dtype=bool)
    kept[part] = True
    kept &= problem.kept(k)
    A = rows_of(trace, np.stack(columns, axis=2))[kept]
    r = rows_of(trace, left)[kept]
    c = np.linalg.lstsq(A.reshape(-1, A.shape[2]), r.reshape(-1), rcond=1e-9)[0]
    for i, e in enumerate(waves):
        effects[e] = replace(effects[e], **{PHASE: float(np.arctan2(c[2 * i + 1], c[2 * i]))})
    return tuple(effects)
