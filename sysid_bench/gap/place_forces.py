"""effects, motion of their places -> their forces along it, some at a time, and the spectra of those."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from sysid_bench.gap.traces import Trace
from sysid_bench.mechanics import stepping
from sysid_bench.mechanics.effect import Effect, law_tapes
from sysid_bench.mechanics.tape import join, over_each
from sysid_bench.nouns import Array

TOGETHER = (
    36  # forces worked out at once: few enough to stay in the cache, enough to share the reading of a tape
)


def force_along(effect: Effect, x: Array, v: Array, h: float, t0: float) -> Array:
    """(N,) force of an effect along a given motion of its place."""
    return forces_along([effect], x, v, h, t0)[:, 0]


def forces_along(effects: list[Effect], x: Array, v: Array, h: float, t0: float) -> Array:
    """(N, len(effects)) forces of some effects at one place along a given motion of it."""
    out = np.empty((len(effects), len(x)))
    for rows, forces in _blocks([effects], x[:, None], v[:, None], h, t0):
        out[rows] = forces
    return out.T


def spectra_at(effects: list[list[Effect]], x: Array, v: Array, trace: Trace) -> list[np.ndarray]:
    """Per place (m, F): spectra of the forces of its effects along its motion x, v (N, places)."""
    ends = np.cumsum([0, *(len(these) for these in effects)])
    out = np.empty((ends[-1], trace.F), dtype=complex)
    for rows, forces in _blocks(effects, x, v, trace.h, trace.t0):
        out[rows] = np.fft.rfft(forces)[:, : trace.F]
    return [out[first:last] for first, last in pairwise(ends)]


def _blocks(
    effects: list[list[Effect]], x: Array, v: Array, h: float, t0: float
) -> Iterator[tuple[list[int], Array]]:
    """(rows, forces (len(rows), N)) of all effects, counted place by place; what is yielded lasts until the next is.

    A kind with memory is one loop for several of it, at whatever places.
    """
    flat = [(p, effect) for p, these in enumerate(effects) for effect in these]
    kinds: dict[tuple, list[int]] = {}
    for row, (_, effect) in enumerate(flat):
        kinds.setdefault((type(effect), effect.numeric), []).append(row)
    x, v, t = np.ascontiguousarray(x.T), np.ascontiguousarray(v.T), t0 + h * np.arange(len(x))
    of_place = list(zip(x, v))  # one array each, by which unchanged inputs are known
    room = np.empty((min(TOGETHER, len(flat)), x.shape[1]))
    for all_rows in kinds.values():
        for first in range(0, len(all_rows), TOGETHER):
            rows = all_rows[first : first + TOGETHER]
            out = room[: len(rows)]
            these = [flat[row] for row in rows]
            if these[0][1].states:
                _remembered(these, x, v, h, t0, out)
            else:
                given = (
                    [*of_place[p], t, h, of_place[p][0], 0.0, *effect.values.tolist()] for p, effect in these
                )
                for force, (found,) in zip(out, over_each(law_tapes(these[0][1])[2], given)):
                    force[:] = found
            yield rows, out


def _remembered(alike: list[tuple[int, Effect]], x: Array, v: Array, h: float, t0: float, out: Array) -> None:
    """Fill out (len(alike), N) with the forces of effects of one kind with states, each at its place; x, v (places, N)."""
    force, states = law_tapes(alike[0][1])[2], alike[0][1].states
    one = join([force])
    cells = np.repeat(one.cells[:, None], len(alike), axis=1)
    for k, (place, effect) in enumerate(alike):
        own = np.concatenate([effect.at_rest(float(x[place, 0])), effect.values])
        cells[stepping.HEAD : stepping.HEAD + len(own), k] = own
    places, tape = np.array([place for place, _ in alike]), (one.operations, force.steady, one.results, cells)
    stepping.along(x, v, places, t0, h, *tape, states, np.arange(len(alike)), out)
