"""fit on the force -> ranked suspects: along a measured motion every effect's force is a column, no simulation needed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid_bench.gap.basis import Basis, thin
from sysid_bench.gap.candidates import Candidate, Screen, free_count, judge
from sysid_bench.gap.decoys import DECOYS
from sysid_bench.gap.descent import Fit
from sysid_bench.gap.inverse import ForceProblem, lone_force, own_phases
from sysid_bench.gap.locate import places
from sysid_bench.gap.problem import frequency_range
from sysid_bench.gap.search import peaks
from sysid_bench.mechanics.effect import Effect, Seen, Suspect, direction
from sysid_bench.nouns import Array, Model

WAVES = 4  # pitches worth trying
BINS = 1 << 15  # of position, for the spectrum over it
SLOW_SHARE = 0.2  # of the samples must pass a ripple slowly enough to show it in the band


def screen_on_force(problem: ForceProblem, fit: Fit, catalogue: list[type[Effect]]) -> Screen:
    """Rank every effect of the catalogue, and the unnamed shapes, at every place, by linear least squares on the force."""
    b = _basis(problem, fit)
    found: list[Candidate] = []
    for place in places(problem.model.n):
        found += _at_place(problem, fit, b, catalogue, place)
    found += _couplings(problem, b, catalogue)
    found += _on_the_input(problem, fit, b, catalogue)
    found.sort(key=lambda x: -x.score)
    return Screen(found, float(b.r @ b.r), _by_place(problem, fit), len(b.r), b.lefts)


def _basis(problem: ForceProblem, fit: Fit) -> Basis:
    """What suspects have to beat: M, D, K, held to the nominal, and the parameters of the effects found so far."""
    theta, nt = fit.point.theta, len(fit.point.theta)
    Z = thin(problem.jacobian(fit.point, fit.runs, fit.parameters))
    r = thin(fit.rows)
    norms = np.maximum(np.linalg.norm(Z, axis=0), 1e-300)
    Z = Z / norms
    W = np.sqrt(max(1.0, fit.rho)) / problem.prior
    ridge = np.zeros((nt, Z.shape[1]))
    ridge[np.arange(nt), np.arange(nt)] = W / norms[:nt]
    Z, r = np.concatenate([Z, ridge]), np.concatenate([r, -W * theta])
    Q, R = np.linalg.qr(Z)
    return Basis(Q, R, norms, r - Q @ (Q.T @ r), r, 0, theta, nt, _lefts(problem, fit))


def _residuals(problem: ForceProblem, fit: Fit) -> list[Array]:
    """(N, n) given minus needed force of each trace."""
    model, out = problem.model_at(fit.point), []
    for k in range(len(problem.traces)):
        own = model if k == 0 else replace(model, effects=own_phases(problem, k, model))
        out.append(problem.residual(own, k))
    return out


def _lefts(problem: ForceProblem, fit: Fit) -> list[np.ndarray]:
    pairs = zip(problem.traces, _residuals(problem, fit))
    return [trace.spectrum(r) * trace.weight for trace, r in pairs]


def _by_place(problem: ForceProblem, fit: Fit) -> dict:
    """Share of the residual force that lies along each place."""
    n, r = problem.model.n, fit.rows.reshape(-1, problem.model.n)
    total, out = max(float(np.sum(r * r)), 1e-300), {}
    for place in places(n):
        c = direction(place, n)
        out[place] = float(np.sum((r @ c) ** 2) / (c @ c) / total)
    return out


def _at_place(problem: ForceProblem, fit: Fit, b: Basis, catalogue, place) -> list[Candidate]:
    n, c = problem.model.n, direction(place, problem.model.n)
    if (problem.motions[0].q @ c).std() == 0:
        return []
    search = ForceSearch(problem, _residuals(problem, fit)[0] @ c / (c @ c), c)
    size = _sizes(problem, c, None, search)
    taken = {(e.name, e.dof) for e in fit.point.effects}
    suspects = [
        (one, kind in DECOYS)
        for kind in (*catalogue, *DECOYS)
        if kind.path == "force" and (kind.name, place) not in taken
        for one in kind(dof=place).suspects(size)
        if not (isinstance(place, tuple) and kind.name == "periodic_disturbance")
    ]
    blocks, groups, at = [], [], 0
    for one, _ in suspects:
        block, make = _columns(problem, one, n)
        blocks.append(block)
        width = block.shape[1]
        groups.append((at, at + width, make, max(width, free_count(one.columns[0]))))
        at += width
    decoy = [is_decoy for _, is_decoy in suspects]
    if isinstance(place, int) and any(k.name == "extra_mode" for k in catalogue):
        block, makes = _hidden_modes(problem, place, catalogue)
        blocks.append(block)
        groups += [(at + i, at + i + 1, make, 3) for i, make in enumerate(makes)]
        decoy += [False] * len(makes)
    return judge(problem, b, np.concatenate(blocks, axis=1), groups, decoy)


def _columns(problem: ForceProblem, one: Suspect, n: int):
    """Rows of a suspect's columns, and its maker; a wave has a phase of its own in every record after the first."""
    parts = []
    for k, (motion, trace) in enumerate(zip(problem.motions, problem.traces)):
        forces = np.stack([lone_force(e, motion, trace, n) for e in one.columns], axis=2)
        parts.append(problem.rows_on(k, forces))
    width = len(one.columns)
    if len(parts) == 1 or "phase" not in one.columns[0].numeric:
        return thin(np.concatenate(parts)), one.make
    total = [np.zeros((len(p), width * len(parts))) for p in parts]
    for k, part in enumerate(parts):
        total[k][:, k * width : (k + 1) * width] = part
    return thin(np.concatenate(total)), lambda y: one.make(y[:width])


def _sizes(problem: ForceProblem, c: Array, channel: int | None, search) -> Seen:
    motion, trace = problem.motions[0], problem.traces[0]
    x, v = motion.q @ c, motion.v @ c
    u = trace.u if channel is None else trace.u[:, [channel]]
    low, _ = frequency_range(problem.model, trace)
    return Seen(
        float(x.std()), float(np.abs(x).max()), float(v.std()), float(u.std()), float(np.abs(u).max()),
        float(np.abs(np.diff(u, axis=0)).max()), trace.h, trace.N * trace.h, low, float(trace.omega[-1]), search,
    )  # fmt: skip


class ForceSearch:
    """Values worth trying for a frequency or a pitch, read off the residual force (N,) along a place."""

    def __init__(self, problem: ForceProblem, force: Array, c: Array):
        motion = problem.motions[0]
        self.trace = problem.traces[0]
        self.force = self.trace.signal(self.trace.spectrum(force - force.mean()))
        self.x, self.v = motion.q @ c, motion.v @ c

    def __call__(self, kind: str) -> list[float]:
        if kind == "pitch":
            return self._pitches()
        carrier = {"tone": 1.0, "damping modulation": self.v}.get(kind, self.x)
        return peaks(self.force * carrier, self.trace.h, WAVES, self.trace.omega[-1])

    def _pitches(self) -> list[float]:
        """Peaks of the spectrum over position, against how long each wave passes slowly enough to lie in the band."""
        low, span = self.x.min(), np.ptp(self.x)
        place = np.minimum(((self.x - low) / span * BINS).astype(int), BINS - 1)
        over = np.bincount(place, self.force, BINS)
        power = np.abs(np.fft.rfft(over, 4 * BINS)) ** 2
        k = 2 * np.pi * np.fft.rfftfreq(4 * BINS, span / BINS)
        speeds = np.sort(np.abs(self.v))
        slow = np.searchsorted(speeds, self.trace.omega[-1] / np.maximum(k, 1e-300)) / len(speeds)
        score = np.where((k * span > 4 * np.pi) & (slow > SLOW_SHARE), power / np.maximum(slow, 1e-9), 0.0)
        found: list[float] = []
        while len(found) < WAVES and score.max() > 0:
            best = int(np.argmax(score))
            found.append(float(2 * np.pi / k[best]))
            score[max(best - 8, 0) : best + 9] = 0
        return found


def _hidden_modes(problem: ForceProblem, place: int, catalogue):
    """Rows and makers of one more mode at a DOF, over a grid finer than the modes are wide."""
    kind = next(k for k in catalogue if k.name == "extra_mode")
    trace = problem.traces[0]
    low, high = 6 * np.pi / (trace.N * trace.h), trace.omega[-1]
    grid = [
        (w, zeta)
        for zeta, spacing in ((0.02, 1.035), (0.1, 1.12))
        for w in np.exp(np.arange(np.log(low), np.log(high), np.log(spacing)))
    ]
    w0, zeta = np.array([g[0] for g in grid]), np.array([g[1] for g in grid])
    parts = []
    for k, (one, motion) in enumerate(zip(problem.traces, problem.motions)):
        w = 2 * np.pi * np.fft.rfftfreq(one.N, one.h)[:, None]
        H = (w0**2 + 2j * zeta * w0 * w) / (w0**2 - w**2 + 2j * zeta * w0 * w)
        H[2 * one.F :] = 0
        A = np.fft.rfft(motion.a[:, place])[:, None]
        forces = np.zeros((one.N, problem.model.n, len(grid)))
        forces[:, place] = np.fft.irfft(A * H, one.N, axis=0)
        parts.append(problem.rows_on(k, forces))

    def maker(w, zeta):
        def make(y):
            if y[0] <= 0:
                return None
            return kind(dof=place, mass=float(y[0]), frequency=float(w / (2 * np.pi)), damping_ratio=zeta)

        return make

    return thin(np.concatenate(parts)), [maker(*g) for g in grid]


def _couplings(problem: ForceProblem, b: Basis, catalogue) -> list[Candidate]:
    """Springs and dampers between DOFs that the nominal leaves apart."""
    kind = next((k for k in catalogue if k.name == "missing_coupling"), None)
    n, (_, _, K) = problem.model.n, problem.model.matrices
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n) if K[i, j] == 0]
    if kind is None or not pairs:
        return []
    blocks, groups = [], []
    for at, pair in enumerate(pairs):
        c, parts = direction(pair, n), []
        for k, motion in enumerate(problem.motions):
            both = np.stack([np.outer(motion.q @ c, c), np.outer(motion.v @ c, c)], axis=2)
            parts.append(problem.rows_on(k, both))
        blocks.append(thin(np.concatenate(parts)))
        groups.append((2 * at, 2 * at + 2, _coupling(kind, pair), 2))
    return judge(problem, b, np.concatenate(blocks, axis=1), groups, [False] * len(groups))


def _coupling(kind, pair):
    return lambda y: kind(dof=pair, stiffness=float(y[0]), damping=float(y[1])) if y[0] > 0 else None


def _on_the_input(problem: ForceProblem, fit: Fit, b: Basis, catalogue) -> list[Candidate]:
    """Actuator effects: what they change in the residual."""
    model, n = problem.model_at(fit.point), problem.model.n
    taken = {(e.name, e.dof) for e in fit.point.effects}
    before = [problem.residual(model, k) for k in range(len(problem.traces))]
    blocks, groups = [], []
    for dof in [i for i in range(n) if np.any(problem.model.input_map[i] != 0)]:
        channel = int(np.flatnonzero(problem.model.input_map[dof])[0])
        size = _sizes(problem, direction(dof, n), channel, lambda kind: [])
        for kind in catalogue:
            if kind.path != "actuator" or (kind.name, dof) in taken:
                continue
            for one in kind(dof=dof).suspects(size):
                column = _change(problem, model, before, one.columns[0])
                if column is None:
                    continue
                blocks.append(thin(column))
                groups.append((len(groups), len(groups) + 1, one.make, free_count(one.columns[0])))
    if not groups:
        return []
    return judge(problem, b, np.column_stack(blocks), groups, [False] * len(groups))


def _change(problem: ForceProblem, model: Model, before: list[Array], effect: Effect) -> Array | None:
    """(rows,) minus what an actuator effect adds to the residual; None where it is the input times a number."""
    changed, parts, plain = replace(model, effects=(*model.effects, effect)), [], []
    for k, (old, trace) in enumerate(zip(before, problem.traces)):
        parts.append(problem.rows_on(k, old - problem.residual(changed, k)))
        plain.append(problem.rows_on(k, trace.u @ model.input_map.T))
    d, u = np.concatenate(parts), np.concatenate(plain)
    size = np.linalg.norm(d)
    if size < 1e-6 * np.linalg.norm(u):
        return None
    return None if np.linalg.norm(d - u * (u @ d) / (u @ u)) < 0.02 * size else d
