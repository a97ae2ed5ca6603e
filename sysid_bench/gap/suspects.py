"""places, catalogue -> the columns of every suspect: forces, hidden masses, couplings, input and sensor effects."""

from __future__ import annotations

import numpy as np

from sysid_bench.gap.basis import Basis, stack
from sysid_bench.gap.candidates import Shelf, free_count, shelved
from sysid_bench.gap.columns import (
    actuated_difference,
    force_columns,
    held_otherwise,
    plain_response,
    sensor_columns,
)
from sysid_bench.gap.decoys import DECOYS
from sysid_bench.gap.hidden_modes import Modes, hidden_modes
from sysid_bench.gap.motion import Seen as SeenMotion
from sysid_bench.gap.place_forces import spectra_at
from sysid_bench.gap.place_rows import place_rows
from sysid_bench.gap.problem import Point, Problem, frequency_range
from sysid_bench.gap.search import Search, Unexplained, sizes
from sysid_bench.mechanics.assembly import effect_channels
from sysid_bench.mechanics.effect import Suspect, direction
from sysid_bench.nouns import Array


def at_places(problem: Problem, point: Point, seens, b: Basis, catalogue, worth: list) -> list[Shelf]:
    """The shelf of every place that moves."""
    n = problem.model.n
    unexplained = Unexplained(problem, seens[0], b.lefts[0])
    listed = [(place, _suspects(problem, point, unexplained, catalogue, place)) for place in worth]
    listed = [(place, suspects) for place, suspects in listed if suspects]
    columns = [[column for one, _ in suspects for column in one.columns] for _, suspects in listed]
    C = np.array([direction(place, n) for place, _ in listed]).reshape(-1, n).T
    spectra = [spectra_at(columns, s.q @ C, s.v @ C, s.trace) for s in seens]
    modes = hidden_modes(problem, seens, catalogue)
    return [
        _shelf(point, seens, b, modes, place, suspects, [each[k] for each in spectra])
        for k, (place, suspects) in enumerate(listed)
    ]


def _suspects(
    problem: Problem, point: Point, unexplained: Unexplained, catalogue, place
) -> list[tuple[Suspect, bool]]:
    """What is suspected at a place, and whether no catalogue names it; nothing where the place does not move."""
    c, first = direction(place, problem.model.n), unexplained.s
    if float((first.q @ c).std()) == 0:
        return []
    search = Search(problem, c, unexplained, frequency_range(problem.model, first.trace)[1])
    size = sizes(problem, first, c, None, search)
    taken = {(e.name, e.dof) for e in point.effects}
    suspects: list[tuple[Suspect, bool]] = []
    for kind in (*catalogue, *DECOYS):
        if kind.path != "force" or (kind.name, place) in taken or _not_here(kind.name, place):
            continue
        suspects += [(one, kind in DECOYS) for one in kind(dof=place).suspects(size)]
    return suspects


def _shelf(
    point: Point, seens, b: Basis, modes: Modes | None, place, suspects, forces: list[np.ndarray]
) -> Shelf:
    """forces: per trace (m, F), spectra of the suspects' columns."""
    c, groups, decoy, at = direction(place, seens[0].q.shape[1]), [], [], 0
    for one, is_decoy in suspects:
        width = len(one.columns)
        groups.append((at, at + width, one.make, max(width, free_count(one.columns[0]))))
        decoy.append(is_decoy)
        at += width
    spectra = [[one] for one in forces]
    known = ("extra_mode", place) in {(e.name, e.dof) for e in point.effects}
    if isinstance(place, int) and modes and not known:  # two at one DOF would follow any force of other DOFs
        spectra = [[one, s.trace.spectrum(s.q @ c) * H] for s, one, H in zip(seens, forces, modes.responses)]
        groups += [(at + k, at + k + 1, modes.maker(place, k), 3) for k in range(len(modes.zeta))]
        decoy += [False] * len(modes.zeta)
    return shelved(b, place_rows(seens, c, spectra, b.ridge), groups, decoy)


def _not_here(name: str, place) -> bool:
    """Forces from outside act on one DOF."""
    return isinstance(place, tuple) and name in ("constant_force", "periodic_disturbance")


def couplings(problem: Problem, seens, b: Basis) -> Shelf | None:
    """Springs and dampers between DOFs that the nominal leaves apart; the diagonal is theirs to move."""
    from sysid_bench.effects.missing_coupling import MissingCoupling

    n, (_, _, K) = problem.model.n, problem.model.matrices
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n) if K[i, j] == 0]
    blocks, groups = [[] for _ in seens], []
    for k, pair in enumerate(pairs):
        c = direction(pair, n)
        for block, s in zip(blocks, seens):
            block.append(force_columns(s, c, np.column_stack([s.q @ c, s.v @ c])))
        groups.append((2 * k, 2 * k + 2, _coupling_maker(MissingCoupling, pair), 2))
    if not pairs:
        return None
    A = stack(seens, [np.concatenate(block, axis=2) for block in blocks])
    return shelved(b, A, groups, [False] * len(groups))


def _coupling_maker(kind, pair):
    return lambda c: kind(dof=pair, stiffness=float(c[0]), damping=float(c[1])) if c[0] > 0 else None


def on_the_input(problem: Problem, point: Point, seens, b: Basis, catalogue) -> Shelf | None:
    L = problem.model.input_map
    blocks, groups, decoy, at = [[] for _ in seens], [], [], 0
    taken = {(e.name, e.dof) for e in point.effects}
    plain = [
        np.concatenate([plain_response(problem, s, channel) for s in seens]) for channel in range(L.shape[1])
    ]
    for kind in (*catalogue, *DECOYS):
        if kind.path != "actuator" or kind.name == "wrong_hold":
            continue
        for channel in range(L.shape[1]):
            dof = int(np.argmax(np.abs(L[:, channel])))
            effect = kind(dof=dof)
            if (kind.name, dof) in taken or effect_channels(effect, L) != [channel]:
                continue
            size = sizes(problem, seens[0], direction(dof, problem.model.n), channel, lambda kind: [])
            for one in effect.suspects(size) if size.u_rms else ():  # a drive at rest shows nothing of itself
                new = [actuated_difference(problem, point, s, None, one.columns[0]) for s in seens]
                if _only_gain(seens, new, plain[channel]):
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
            block.append(held_otherwise(problem, s, hold))
        groups.append((at, at + 1, _hold_maker(kind, hold), 1))
        decoy.append(False)
        at += 1
    if not groups:
        return None
    return shelved(b, stack(seens, [np.concatenate(block, axis=2) for block in blocks]), groups, decoy)


def _hold_maker(kind, hold):
    return lambda c: kind(dof=None, hold=hold) if 0.6 < c[0] < 1.5 else None


def _only_gain(seens: list[SeenMotion], columns: list[np.ndarray], plain: Array) -> bool:
    """True where a changed input acts in the band as the input times a number, the same in all records: a gain, not an effect."""
    d = np.concatenate([s.trace.rows(column)[:, 0] for s, column in zip(seens, columns)])
    size = np.linalg.norm(d)
    if size < 1e-6 * np.linalg.norm(plain):
        return True
    return bool(np.linalg.norm(d - plain * (plain @ d) / max(plain @ plain, 1e-300)) < 0.02 * size)


def on_the_sensors(problem: Problem, seens, b: Basis, catalogue) -> Shelf | None:
    known = {k.name: k for k in catalogue}
    C = problem.model.output_map
    blocks, groups, at = [[] for _ in seens], [], 0
    for channel in range(len(C)):
        dof = int(np.argmax(np.abs(C[channel])))
        for name in ("sensor_bias", "sensor_drift", "sensor_scale"):
            if name not in known or (name == "sensor_scale" and len(C) < 2):
                continue
            for block, s in zip(blocks, seens):
                block.append(sensor_columns(s, name, channel))
            width = blocks[0][-1].shape[2]
            duration = seens[0].trace.N * seens[0].trace.h
            groups.append((at, at + width, _sensor_maker(known[name], dof, duration), width))
            at += width
    if not groups:
        return None
    A = stack(seens, [np.concatenate(block, axis=2) for block in blocks])
    return shelved(b, A, groups, [False] * len(groups))


def _sensor_maker(kind, dof: int, duration: float):
    def make(c):
        if kind.name == "sensor_bias":
            return kind(dof=dof, bias=float(c[0]))
        if kind.name == "sensor_scale":
            return kind(dof=dof, factor=1 + float(c[0])) if -0.6 < c[0] < 1.5 else None
        return kind(dof=dof, rate=float(c[0]) / duration, curvature=float(c[1]) / duration**2)

    return make
