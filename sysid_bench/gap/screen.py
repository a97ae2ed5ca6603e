"""fit -> ranked suspects: every effect at every place, one linear least squares each.

With the true motion, measured minus linear response = -G (dM a + dD v + dK q + force) exactly, for any linear model:
so a suspect's force, filtered by G, is fitted together with M, D, K (held to the nominal), the free response and the
effects already accepted; its score is the energy it explains beyond them, minus a price per parameter.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from sysid_bench.gap.decoys import DECOYS
from sysid_bench.gap.motion import Seen as SeenMotion
from sysid_bench.gap.motion import force_along, free_response, seen
from sysid_bench.gap.problem import Fit, Point, Problem, frequency_range
from sysid_bench.gap.traces import Trace
from sysid_bench.mechanics.effect import Effect, Seen, Suspect, direction
from sysid_bench.mechanics.nonlinear import actuated, effect_channels, trajectory
from sysid_bench.nouns import Array

MOST_PLACES = 8
MOST_ROWS = 6000


@dataclass(frozen=True, eq=False)
class Candidate:
    """A suspect with its evidence. explained: energy beyond what M, D, K explain; score: minus the price of parameters."""

    effect: Effect
    explained: float
    score: float
    coefficients: Array
    theta: Array
    decoy: bool
    origin: Effect | None = None  # before it was polished
    unit_energy: float = 0.0  # energy that its first unit form adds beyond M, D, K

    @property
    def place(self):
        return self.effect.dof


@dataclass(frozen=True, eq=False)
class Screen:
    """candidates, best first; left: energy that M, D, K leave; by_place: share that some force at a place explains."""

    candidates: list[Candidate]
    left: float
    by_place: dict
    rows: int
    lefts: list[np.ndarray]
    basis: Basis | None = None  # of a free run: what polishing and pairs go on from
    seens: list[SeenMotion] = field(default_factory=list)
    point: Point | None = None
    shelves: list[Shelf] = field(default_factory=list)

    def promise(self, explained: float) -> float:
        """rho that is left where so much is explained."""
        return max((self.left - explained) / self.rows, 1.0)


@dataclass(frozen=True, eq=False)
class Shelf:
    """Columns that were judged together: A (rows, m) of unit norm, QA their share in the basis, groups of suspects.

    grams: per group, the Gram matrix of its columns beyond the basis
    """

    A: Array
    QA: Array
    norms: Array
    grams: list[Array]
    groups: list
    decoy: list[bool]


@dataclass(frozen=True, eq=False)
class Basis:
    """What suspects have to beat: Q orthonormal over rows and ridge rows, R its triangle, r what is left."""

    Q: Array
    R: Array
    norms: Array
    r: Array
    target: Array
    offset: int  # first column of theta
    theta0: Array
    ridge: int  # rows appended for the prior
    lefts: list[np.ndarray]  # per trace (F, ny): whitened spectrum of what is left
    noise: float = 1.0  # rms of a row beyond all columns, at least 1: what the prior was weighed with
    held: Array = field(default_factory=lambda: np.zeros(0))  # (ntheta,) its rows' entries, in units of norms


def theta_columns(problem: Problem, s: SeenMotion) -> np.ndarray:
    """(F, ny, ntheta) response to a unit change of each entry."""
    B = [s.trace.spectrum(x) for x in (s.a, s.v, s.q)]
    out = np.empty((s.trace.F, s.G.shape[1], len(problem.entries)), dtype=complex)
    for k, ((m, i, j), scale) in enumerate(zip(problem.entries, problem.scale)):
        column = s.G[:, :, i] * B[m][:, j, None]
        if i != j:
            column = column + s.G[:, :, j] * B[m][:, i, None]
        out[:, :, k] = -scale * column
    return out


def force_columns(s: SeenMotion, c: Array, forces: Array) -> np.ndarray:
    """(F, ny, m) response to forces (N, m) along c that the model lacks (they stand on the left-hand side)."""
    g = s.G[:, :, : len(c)] @ c
    return -g[:, :, None] * s.trace.spectrum(forces)[:, None, :]


def _own_columns(problem: Problem, point: Point, s: SeenMotion) -> np.ndarray:
    """Columns of the effects that are already in the model, and of their parameters."""
    n, columns = problem.model.n, []
    for effect in point.effects:
        if effect.path == "force":
            c = direction(effect.dof, n)
            x, v = s.q @ c, s.v @ c
            f0 = force_along(effect, x, v, s.trace.h, s.trace.t0)
            forces = [f0]
            for p, key in enumerate(effect.numeric):
                if key in effect.held:
                    continue
                step = 1e-3 * max(abs(effect.values[p]), 1e-6)
                moved = effect.with_values(effect.values + step * np.eye(len(effect.values))[p])
                forces.append((force_along(moved, x, v, s.trace.h, s.trace.t0) - f0) / step)
            columns.append(force_columns(s, c, np.column_stack(forces)))
        if effect.path == "structure":
            c = direction(effect.dof, n)
            columns.append(force_columns(s, c, np.column_stack([s.q @ c, s.v @ c, s.a @ c])))
        if effect.path == "sensor":
            channel = int(np.argmax(np.abs(problem.model.output_map[:, effect.dof or 0])))
            columns.append(_sensor_columns(s, effect.name, channel))
        if effect.path == "actuator" and effect.numeric:
            step = 0.02 * max(effect.values[0], 1e-9)
            columns.append(
                actuated_difference(problem, point, s, effect, effect.with_values(effect.values + step))
            )
    return (
        np.concatenate(columns, axis=2) if columns else np.zeros((s.trace.F, s.G.shape[1], 0), dtype=complex)
    )


def _sensor_columns(s: SeenMotion, name: str, channel: int) -> np.ndarray:
    t = np.arange(s.trace.N) / s.trace.N
    if name == "sensor_scale":  # the linear response, not the measurement: that would explain itself away
        shapes = [_linear_output(s)[:, channel]]
    else:
        shapes = [np.ones(s.trace.N)] if name == "sensor_bias" else [t, t * t]
    out = np.zeros((s.trace.F, s.G.shape[1], len(shapes)), dtype=complex)
    out[:, channel, :] = s.trace.spectrum(np.column_stack(shapes))
    return out


def _linear_output(s: SeenMotion) -> Array:
    return s.trace.y - s.trace.signal(s.left)


def actuated_difference(
    problem: Problem, point: Point, s: SeenMotion, old: Effect | None, new: Effect
) -> np.ndarray:
    """(F, ny, 1) change of the linear model's response when one actuator effect is replaced or added."""
    run, trace = s.linear, s.trace
    A = run.assembly
    others = [e for e in A.actuators if e is not old]
    small = trace.h / run.substeps
    stages = trace.stages(run.substeps)
    before = actuated(replace(A, actuators=tuple([*others, *([old] if old else [])])), stages, small)
    after = actuated(replace(A, actuators=(*others, new)), stages, small)
    moved = trajectory(replace(A, actuators=()), after - before, trace.h, run.substeps)
    return _measured_spectrum(problem, trace, moved)


def _measured_spectrum(problem: Problem, trace: Trace, run) -> np.ndarray:
    q, v, a = run.motion()
    y = {"displacement": q, "velocity": v, "acceleration": a}[problem.model.output] @ run.assembly.C.T
    return trace.spectrum(y)[:, :, None]


def basis(problem: Problem, point: Point, seens: list[SeenMotion], prior_scale: float) -> Basis:
    """Orthonormal basis of everything that explains without a new effect, theta held to the nominal by ridge rows."""
    shared, free, targets = [], [], []
    for s in seens:
        free.append(s.trace.rows(free_response(s.linear.assembly, s.trace, problem.model.output)))
        own = np.concatenate([theta_columns(problem, s), _own_columns(problem, point, s)], axis=2)
        shared.append(s.trace.rows(own))
        targets.append(s.trace.rows(s.left))
    offset = sum(x.shape[1] for x in free)
    Z = np.concatenate(
        [np.hstack([_placed(thin(f), free, k), thin(z)]) for k, (f, z) in enumerate(zip(free, shared))]
    )
    r = np.concatenate([thin(t) for t in targets])
    norms = np.maximum(np.linalg.norm(Z, axis=0), 1e-300)
    Z = Z / norms
    Q, _ = np.linalg.qr(Z)
    left = r - Q @ (Q.T @ r)
    noise = np.sqrt(max(1.0, left @ left / len(r)))
    # the prior pulls the total change of theta from the nominal, not the step from this linear model
    theta0, nt = _theta_of(problem, seens[0]), len(problem.entries)
    W = noise / (problem.prior * prior_scale)
    ridge = np.zeros((nt, Z.shape[1]))
    ridge[np.arange(nt), offset + np.arange(nt)] = W / norms[offset : offset + nt]
    Z, r = np.concatenate([Z, ridge]), np.concatenate([r, -W * theta0])
    Q, R = np.linalg.qr(Z)
    x = np.linalg.lstsq(R, Q.T @ r, rcond=1e-9)[0] / norms
    lefts, at = [], 0
    for s, f, z, t in zip(seens, free, shared, targets):
        rows = t - f @ x[at : at + f.shape[1]] - z @ x[offset:]
        lefts.append((rows[: len(rows) // 2] + 1j * rows[len(rows) // 2 :]).reshape(s.trace.F, -1))
        at += f.shape[1]
    held = W / norms[offset : offset + nt]
    return Basis(
        Q,
        R,
        norms,
        r - Q @ (Q.T @ r),
        r,
        offset,
        theta0,
        nt,
        lefts,
        float(noise),
        held,
    )


def _placed(block: Array, blocks: list[Array], k: int) -> Array:
    """A trace's own columns among those of all traces: zero elsewhere."""
    before = sum(x.shape[1] for x in blocks[:k])
    after = sum(x.shape[1] for x in blocks[k + 1 :])
    return np.pad(block, ((0, 0), (before, after)))


def _theta_of(problem: Problem, s: SeenMotion) -> Array:
    n, A = problem.model.n, s.linear.assembly
    now = (A.M[:n, :n], A.D[:n, :n], A.K[:n, :n])
    then = (problem.model.mass, problem.model.damping, problem.model.stiffness)
    return np.array(
        [(now[m] - then[m])[i, j] / scale for (m, i, j), scale in zip(problem.entries, problem.scale)]
    )


def places(n: int) -> list:
    """Every DOF and every pair of DOFs."""
    return [*range(n), *((i, j) for i in range(n) for j in range(i + 1, n))]


def explained_by_place(
    problem: Problem, point: Point, seens: list[SeenMotion], b: Basis, prior_scale: float
) -> dict:
    """Share of what is left that some force history at one place could explain, M, D, K refitted, for every place.

    A force along c moves the channels along g = G c at each frequency; what lies across g cannot come from there.
    """
    traces = [_whitened(problem, point, s) for s in seens]
    offset = b.offset
    plain = _leftover(traces, None, b, problem.prior * prior_scale, offset)
    out = {}
    for place in places(problem.model.n):
        c = direction(place, problem.model.n)
        out[place] = 1 - _leftover(traces, c, b, problem.prior * prior_scale, offset) / max(plain, 1e-300)
    return out


def _whitened(problem: Problem, point: Point, s: SeenMotion):
    """(Z, r, G): complex whitened columns (F, ny, p), target (F, ny), response (F, ny, n) of one trace."""
    free = free_response(s.linear.assembly, s.trace, problem.model.output)
    own = np.concatenate([theta_columns(problem, s), _own_columns(problem, point, s)], axis=2)
    w = s.trace.weight[:, :, None]
    return free * w, own * w, s.left * s.trace.weight, s.G[:, :, : problem.model.n] * w


def _leftover(traces, c: Array | None, b: Basis, prior: Array, offset: int) -> float:
    """Energy across G c that M, D, K and the free response cannot explain; all of it where c is None."""
    size = len(b.norms)
    gram, right, energy, rows, at = np.zeros((size, size)), np.zeros(size), 0.0, 0, 0
    for free, own, r, G in traces:
        Z = np.concatenate([free, own], axis=2)
        where = np.concatenate([np.arange(at, at + free.shape[2]), np.arange(offset, size)])
        Z, at = Z / b.norms[where], at + free.shape[2]
        flat, target = Z.reshape(-1, Z.shape[2]), r.reshape(-1)
        part = (flat.conj().T @ flat).real
        match = (flat.conj().T @ target).real
        energy += float(np.sum(np.abs(r) ** 2))
        rows += r.size * 2
        if c is not None:
            g = G @ c
            g = g / np.maximum(np.linalg.norm(g, axis=1), 1e-300)[:, None]
            along = np.einsum("fc,fcp->fp", g.conj(), Z, optimize=True)
            hit = np.einsum("fc,fc->f", g.conj(), r)
            part -= (along.conj().T @ along).real
            match -= (along.conj().T @ hit).real
            energy -= float(np.sum(np.abs(hit) ** 2))
            rows -= 2 * len(hit)
        gram[np.ix_(where, where)] += part
        right[where] += match
    nt, left = len(prior), energy
    held = np.zeros(size)
    for _ in range(2):
        pull = max(1.0, left / max(rows, 1)) / prior**2
        held[offset : offset + nt] = pull / b.norms[offset : offset + nt] ** 2
        toward = np.zeros(size)
        toward[offset : offset + nt] = -pull * b.theta0 / b.norms[offset : offset + nt]
        x = np.linalg.solve(gram + np.diag(held + 1e-9), right + toward)
        left = max(energy - 2 * right @ x + x @ gram @ x, 0.0)
    return left


def unexplained_force(problem: Problem, s: SeenMotion, left: np.ndarray) -> tuple[Array, Array]:
    """(N, n) adjoint force and (N, ny) residual of one trace, from the whitened spectrum that is left."""
    R = left * s.trace.weight
    return s.trace.signal(np.einsum("fci,fc->fi", s.G[:, :, : problem.model.n].conj(), R)), s.trace.signal(R)


class Search:
    """Values worth trying for a frequency or a pitch, read off the unexplained force at one place."""

    def __init__(self, problem: Problem, s: SeenMotion, c: Array, force: Array, residual: Array, low, high):
        self.problem, self.s, self.c, self.high, self.low = problem, s, c, high, low
        self.force, self.residual = force @ c, residual
        self.x, self.v = s.q @ c, s.v @ c

    def __call__(self, kind: str) -> list[float]:
        if kind == "pitch":
            return self._pitches()
        if kind == "tone":
            raw = self.s.trace.signal(self.s.left)
            found = self._peaks(self.force, 2, self.s.trace.omega[-1])
            for channel in self._listening():
                found += self._peaks(self.residual[:, channel], 1, self.s.trace.omega[-1])
                found += self._peaks(raw[:, channel], 1, self.s.trace.omega[-1])
            return sorted(set(found))
        carrier = self.v if kind == "damping modulation" else self.x
        return self._peaks(self.force * carrier, 3, 2.2 * self.high)

    def _listening(self) -> list[int]:
        """Channels in which a tone at this place is heard: all of a few, else its own sensor, else the loudest."""
        C, c = self.problem.model.output_map, self.c
        if len(C) <= 3:
            return list(range(len(C)))
        own = np.abs(C @ c)
        heard = own if own.max() > 0 else np.sum(np.abs(self.s.G[:, :, : len(c)] @ c) ** 2, axis=0)
        return [int(np.argmax(heard))]

    def _peaks(self, x: Array, count: int, top: float) -> list[float]:
        N = 4 * len(x)
        power = np.abs(np.fft.rfft(x, N)) ** 2
        omega = 2 * np.pi * np.fft.rfftfreq(N, self.s.trace.h)
        last, found = int(np.searchsorted(omega, top)), []
        for _ in range(count):
            k = 3 + int(np.argmax(power[3:last]))
            found.append(float(omega[k] / (2 * np.pi)))
            power[max(k - 8, 0) : k + 9] = 0
        return found

    def _pitches(self) -> list[float]:
        """Largest |sum force exp(i k x)| against the size of its response."""
        s, x = self.s, self.x
        rms = max(x.std(), 1e-300)
        ks = np.concatenate([np.arange(1.2, 8, 0.2), np.arange(8, 24, 0.4)]) / rms
        waves = np.exp(1j * np.outer(ks, x))
        match = np.abs(waves @ self.force) ** 2
        g = (s.G[:, :, : len(self.c)] @ self.c) * s.trace.weight
        energy = np.sum(np.abs(g) ** 2, axis=1)
        size = np.abs(np.fft.fft(waves, axis=1)[:, : s.trace.F]) ** 2 @ energy
        best = np.argsort(-match / np.maximum(size, 1e-300))[:4]
        return [float(2 * np.pi / ks[k]) for k in best]


def screen(
    problem: Problem, fit: Fit, catalogue: list[type[Effect]], prior_scale: float = 0.7, absent: tuple = ()
) -> Screen:
    """Rank every effect of the catalogue, and the decoys, at every place. absent: (name, place) not to be tried."""
    seens = [
        seen(problem, fit.point, trace, run, x0)
        for trace, run, x0 in zip(problem.traces, fit.runs, fit.point.starts)
    ]
    b = basis(problem, fit.point, seens, prior_scale)
    by_place = explained_by_place(problem, fit.point, seens, b, prior_scale)
    worth = places(problem.model.n)
    if problem.model.n > 3:
        promise = {place: _promise(problem, seens, b, place) for place in worth}
        half = MOST_PLACES // 2
        worth = sorted(promise, key=lambda place: -promise[place])[:half]
        worth += [
            place
            for place in sorted(by_place, key=lambda place: -by_place[place])[:half]
            if place not in worth
        ]
    shelves = [_at_place(problem, fit.point, seens, b, catalogue, place) for place in worth]
    if any(k.name == "missing_coupling" for k in catalogue):
        shelves.append(_couplings(problem, seens, b))
    shelves.append(_on_the_input(problem, fit.point, seens, b, catalogue))
    shelves.append(_on_the_sensors(problem, seens, b, catalogue))
    shelves = [x for x in shelves if x is not None]
    found = [x for one in shelves for x in _judge(problem, b, one)]
    found = [x for x in found if (x.effect.name, x.place) not in absent]
    found.sort(key=lambda x: -x.score)
    return Screen(found, float(b.r @ b.r), by_place, len(b.r), b.lefts, b, seens, fit.point, shelves)


def _shelved(b: Basis, A: Array, groups: list, decoy: list[bool]) -> Shelf:
    """Columns A (rows, m) made ready; groups: (first, last, make, price) of each suspect."""
    A = np.concatenate([A, np.zeros((b.ridge, A.shape[1]))])
    norms = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    A = A / norms
    QA = b.Q.T @ A
    grams = [_square(A[:, i:j]) - _square(QA[:, i:j]) for i, j, _, _ in groups]
    return Shelf(A, QA, norms, grams, groups, decoy)


def _square(A: Array) -> Array:
    return A.T @ A


def _judge(problem: Problem, b: Basis, shelf: Shelf, known: Array | None = None) -> list[Candidate]:
    """Candidates of a shelf. known (rows, k): orthonormal, beyond the basis: what is explained already."""
    r, KA = b.r, None
    if known is not None:
        KA = known.T @ shelf.A
        r = r - known @ (known.T @ r)
    target = shelf.A.T @ r
    price, nt = np.log(len(b.r)), len(problem.entries)
    solve, projected, QA = np.linalg.pinv(b.R, rcond=1e-9), b.Q.T @ b.target, shelf.QA
    out = []
    for (first, last, make, parameters), gram, is_decoy in zip(shelf.groups, shelf.grams, shelf.decoy):
        S = gram + 1e-6 * np.eye(last - first)
        if KA is not None:
            S = S - _square(KA[:, first:last])
        y = np.linalg.solve(S, target[first:last])
        explained = float(2 * y @ target[first:last] - y @ S @ y)
        if not np.isfinite(explained):
            continue
        c = y / shelf.norms[first:last]
        effect = make(c)
        if effect is None:
            continue
        x = solve @ (projected - QA[:, first:last] @ y) / b.norms
        theta = np.clip(b.theta0 + x[b.offset : b.offset + nt], -0.95, 2.0)
        unit = float(gram[0, 0] * shelf.norms[first] ** 2)
        out.append(
            Candidate(effect, explained, explained - parameters * price, c, theta, is_decoy, unit_energy=unit)
        )
    return out


def judge(problem: Problem, b: Basis, A: Array, groups: list, decoy: list[bool]) -> list[Candidate]:
    """Candidates of the columns A (rows, m); groups: (first, last, make, price) of each suspect."""
    return _judge(problem, b, _shelved(b, A, groups, decoy))


def beside(problem: Problem, screened: Screen, columns: Array) -> list[Candidate]:
    """All suspects again, best first, given that columns (rows, k), beyond the basis, explain what they can."""
    known, _ = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))
    found = [x for one in screened.shelves for x in _judge(problem, screened.basis, one, known)]
    return sorted(found, key=lambda x: -x.score)


def _stack(seens: list[SeenMotion], columns: list[np.ndarray]) -> Array:
    return np.concatenate([thin(s.trace.rows(c)) for s, c in zip(seens, columns)])


def thin(rows: Array) -> Array:
    """Few enough rows for a screen: neighbours added with random signs (a count sketch; Clarkson, Woodruff 2013).

    What explains everything before does so after: the map is linear.
    """
    fold = -(-len(rows) // MOST_ROWS)
    if fold == 1:
        return rows
    signs = np.random.default_rng(len(rows)).choice([-1.0, 1.0], len(rows))
    padded = np.zeros((-(-len(rows) // fold) * fold, *rows.shape[1:]))
    padded[: len(rows)] = rows * signs.reshape(-1, *([1] * (rows.ndim - 1)))
    return padded.reshape(-1, fold, *rows.shape[1:]).sum(axis=1)


def free_count(effect: Effect) -> int:
    return sum(key not in effect.held and key not in ("speed", "damping") for key in effect.numeric)


def sizes(problem: Problem, s: SeenMotion, c: Array, channel: int | None, search) -> Seen:
    """What a suspect may know of its place."""
    x, v = s.q @ c, s.v @ c
    u = s.trace.u if channel is None else s.trace.u[:, [channel]]
    low, high = frequency_range(problem.model, s.trace)
    fastest = np.abs(np.diff(u, axis=0)).max() if len(u) else 0.0
    return Seen(
        float(x.std()), float(np.abs(x).max()), float(v.std()), float(u.std()), float(np.abs(u).max()),
        float(fastest), s.trace.h, s.trace.N * s.trace.h, low, high, search,
    )  # fmt: skip


def _promise(problem: Problem, seens, b: Basis, place) -> float:
    """Energy that a handful of general shapes explains together at a place: whether it is worth the whole catalogue."""
    c = direction(place, problem.model.n)
    blocks = []
    for s in seens:
        x, v = s.q @ c, s.v @ c
        z, w = x / max(x.std(), 1e-300), v / max(v.std(), 1e-300)
        shapes = [
            np.sign(w),
            np.abs(w) * w,
            z**3,
            z * z,
            np.clip(z, -0.5, 0.5),
            np.ones_like(z),
            _follower(z),
        ]
        blocks.append(force_columns(s, c, np.column_stack(shapes)))
    A = np.concatenate([_stack(seens, blocks), np.zeros((b.ridge, blocks[0].shape[2]))])
    A /= np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    QA, target = b.Q.T @ A, A.T @ b.r
    return float(target @ np.linalg.solve(A.T @ A - QA.T @ QA + 1e-6 * np.eye(len(target)), target))


def _follower(z: Array) -> Array:
    """How far a place has moved since it last turned, up to a limit: what hysteresis and play depend on."""
    turned = np.concatenate([[True], np.diff(np.sign(np.diff(z, prepend=z[0]))) != 0])
    last = np.maximum.accumulate(np.where(turned, np.arange(len(z)), 0))
    return np.clip(z - z[last], -0.6, 0.6)


def _at_place(problem: Problem, point: Point, seens, b: Basis, catalogue, place) -> Shelf | None:
    n = problem.model.n
    c = direction(place, n)
    first = seens[0]
    force, residual = unexplained_force(problem, first, b.lefts[0])
    x_rms = float((first.q @ c).std())
    if x_rms == 0:
        return None
    low, high = frequency_range(problem.model, seens[0].trace)
    search = Search(problem, first, c, force, residual, low, high)
    size = sizes(problem, first, c, None, search)
    taken = {(e.name, e.dof) for e in point.effects}
    suspects: list[tuple[Suspect, bool]] = []
    for kind in (*catalogue, *DECOYS):
        if kind.path != "force" or (kind.name, place) in taken or _not_here(kind.name, place):
            continue
        suspects += [(one, kind in DECOYS) for one in kind(dof=place).suspects(size)]
    columns, groups, decoy, at = [], [], [], 0
    for one, is_decoy in suspects:
        columns += list(one.columns)
        width = len(one.columns)
        groups.append((at, at + width, one.make, max(width, free_count(one.columns[0]))))
        decoy.append(is_decoy)
        at += width
    forces = [
        np.column_stack([force_along(e, s.q @ c, s.v @ c, s.trace.h, s.trace.t0) for e in columns])
        for s in seens
    ]
    blocks = [force_columns(s, c, f) for s, f in zip(seens, forces)]
    if isinstance(place, int) and any(k.name == "extra_mode" for k in catalogue):
        more, makes = _hidden_modes(problem, seens, c, place, catalogue)
        blocks = [np.concatenate([one, two], axis=2) for one, two in zip(blocks, more)]
        for make in makes:
            groups.append((at, at + 1, make, 3))
            decoy.append(False)
            at += 1
    return _shelved(b, _stack(seens, blocks), groups, decoy)


def _not_here(name: str, place) -> bool:
    """Forces from outside act on one DOF."""
    return isinstance(place, tuple) and name in ("constant_force", "periodic_disturbance")


def _hidden_modes(problem: Problem, seens, c: Array, place: int, catalogue):
    """Columns and makers of one more mode at a DOF, over a grid finer than the modes are wide."""
    kind = next(k for k in catalogue if k.name == "extra_mode")
    low, high = frequency_range(problem.model, seens[0].trace)
    grid = [
        (w, zeta)
        for zeta, spacing in ((0.02, 1.035), (0.08, 1.1))
        for w in np.exp(np.arange(np.log(max(0.4 * low, 0.02 * high)), np.log(2.2 * high), np.log(spacing)))
    ]
    w0, zeta = np.array([g[0] for g in grid]), np.array([g[1] for g in grid])
    blocks = [_mode_columns(s, c, w0, zeta) for s in seens]

    def maker(w, zeta):
        return lambda k: (
            kind(dof=place, mass=float(k[0]), frequency=float(w / (2 * np.pi)), damping_ratio=zeta)
            if k[0] > 0
            else None
        )

    return blocks, [maker(*g) for g in grid]


def _mode_columns(s: SeenMotion, c: Array, w0: Array, zeta: Array) -> np.ndarray:
    """(F, ny, m) response to hidden masses of 1 kg that resonate at w0 (m,) rad/s with damping ratio zeta (m,)."""
    w = s.trace.omega[:, None]
    H = -(w**2) * (w0**2 + 2j * zeta * w0 * w) / (w0**2 - w**2 + 2j * zeta * w0 * w)
    X = s.trace.spectrum(s.q @ c)[:, None] * H
    return -(s.G[:, :, : len(c)] @ c)[:, :, None] * X[:, None, :]


def mode_column(problem: Problem, s: SeenMotion, mode: Effect) -> np.ndarray:
    """(F, ny) response to one hidden mode."""
    w0, zeta = np.array([2 * np.pi * mode.frequency]), np.array([mode.damping_ratio])
    return mode.mass * _mode_columns(s, direction(mode.dof, problem.model.n), w0, zeta)[:, :, 0]


def _couplings(problem: Problem, seens, b: Basis) -> Shelf | None:
    """Springs and dampers between DOFs that the nominal leaves apart; the diagonal is theirs to move."""
    from sysid_bench.effects.missing_coupling import MissingCoupling

    n, K = problem.model.n, problem.model.stiffness
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n) if K[i, j] == 0]
    blocks, groups = [[] for _ in seens], []
    for k, pair in enumerate(pairs):
        c = direction(pair, n)
        for block, s in zip(blocks, seens):
            block.append(force_columns(s, c, np.column_stack([s.q @ c, s.v @ c])))
        groups.append((2 * k, 2 * k + 2, _coupling_maker(MissingCoupling, pair), 2))
    if not pairs:
        return None
    A = _stack(seens, [np.concatenate(block, axis=2) for block in blocks])
    return _shelved(b, A, groups, [False] * len(groups))


def _coupling_maker(kind, pair):
    return lambda c: kind(dof=pair, stiffness=float(c[0]), damping=float(c[1])) if c[0] > 0 else None


def _on_the_input(problem: Problem, point: Point, seens, b: Basis, catalogue) -> Shelf | None:
    L = problem.model.input_map
    blocks, groups, decoy, at = [[] for _ in seens], [], [], 0
    taken = {(e.name, e.dof) for e in point.effects}
    plain = [_plain_response(problem, seens[0], channel) for channel in range(L.shape[1])]
    for kind in (*catalogue, *DECOYS):
        if kind.path != "actuator" or kind.name == "wrong_hold":
            continue
        for channel in range(L.shape[1]):
            dof = int(np.argmax(np.abs(L[:, channel])))
            effect = kind(dof=dof)
            if (kind.name, dof) in taken or effect_channels(effect, L) != [channel]:
                continue
            size = sizes(problem, seens[0], direction(dof, problem.model.n), channel, lambda kind: [])
            for one in effect.suspects(size):
                new = [actuated_difference(problem, point, s, None, one.columns[0]) for s in seens]
                if _only_gain(seens[0], new[0], plain[channel]):
                    continue
                for block, column in zip(blocks, new):
                    block.append(column)
                groups.append((at, at + 1, one.make, 1))
                decoy.append(kind in DECOYS)
                at += 1
    for hold in () if any(e.name == "wrong_hold" for e in point.effects) else ("zoh", "foh", "cubic"):
        if not any(k.name == "wrong_hold" for k in catalogue) or hold == seens[0].trace.hold:
            continue
        kind = next(k for k in catalogue if k.name == "wrong_hold")
        for block, s in zip(blocks, seens):
            block.append(_held_otherwise(problem, s, hold))
        groups.append((at, at + 1, _hold_maker(kind, hold), 1))
        decoy.append(False)
        at += 1
    if not groups:
        return None
    return _shelved(b, _stack(seens, [np.concatenate(block, axis=2) for block in blocks]), groups, decoy)


def _hold_maker(kind, hold):
    return lambda c: kind(dof=None, hold=hold) if 0.6 < c[0] < 1.5 else None


def _held_otherwise(problem: Problem, s: SeenMotion, hold: str) -> np.ndarray:
    run, trace = s.linear, s.trace
    substeps = max(run.substeps, 2)
    change = trace.stages(substeps, hold) - trace.stages(substeps)
    moved = trajectory(replace(run.assembly, actuators=()), change, trace.h, substeps)
    return _measured_spectrum(problem, trace, moved)


def _plain_response(problem: Problem, s: SeenMotion, channel: int) -> Array:
    """Rows of the linear model's response to one input channel alone."""
    stages = np.zeros_like(s.trace.stages(s.linear.substeps))
    stages[:, :, channel] = s.trace.stages(s.linear.substeps)[:, :, channel]
    run = trajectory(replace(s.linear.assembly, actuators=()), stages, s.trace.h, s.linear.substeps)
    return s.trace.rows(_measured_spectrum(problem, s.trace, run))[:, 0]


def _only_gain(s: SeenMotion, column: np.ndarray, plain: Array) -> bool:
    """True where a changed input acts in the band as the input times a number: a gain, not an effect."""
    d = s.trace.rows(column)[:, 0]
    size = np.linalg.norm(d)
    if size < 1e-6 * np.linalg.norm(plain):
        return True
    return bool(np.linalg.norm(d - plain * (plain @ d) / max(plain @ plain, 1e-300)) < 0.02 * size)


def _on_the_sensors(problem: Problem, seens, b: Basis, catalogue) -> Shelf | None:
    known = {k.name: k for k in catalogue}
    C = problem.model.output_map
    blocks, groups, at = [[] for _ in seens], [], 0
    for channel in range(len(C)):
        dof = int(np.argmax(np.abs(C[channel])))
        for name in ("sensor_bias", "sensor_drift", "sensor_scale"):
            if name not in known or (name == "sensor_scale" and len(C) < 2):
                continue
            for block, s in zip(blocks, seens):
                block.append(_sensor_columns(s, name, channel))
            width = blocks[0][-1].shape[2]
            duration = seens[0].trace.N * seens[0].trace.h
            groups.append((at, at + width, _sensor_maker(known[name], dof, duration), width))
            at += width
    if not groups:
        return None
    A = _stack(seens, [np.concatenate(block, axis=2) for block in blocks])
    return _shelved(b, A, groups, [False] * len(groups))


def _sensor_maker(kind, dof: int, duration: float):
    def make(c):
        if kind.name == "sensor_bias":
            return kind(dof=dof, bias=float(c[0]))
        if kind.name == "sensor_scale":
            return kind(dof=dof, factor=1 + float(c[0])) if -0.6 < c[0] < 1.5 else None
        return kind(dof=dof, rate=float(c[0]) / duration, curvature=float(c[1]) / duration**2)

    return make
