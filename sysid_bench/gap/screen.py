"""fit -> ranked suspects: every effect at every place, one linear least squares each.

With the true motion, measured minus linear response = -G (dM a + dD v + dK q + force) exactly, for any linear model:
so a suspect's force, filtered by G, is fitted together with M, D, K (held to the nominal), the free response and the
effects already accepted; its score is the energy it explains beyond them, minus a price per parameter.
"""

from __future__ import annotations

from sysid_bench.gap.basis import basis
from sysid_bench.gap.candidates import Screen, Shelf, judged
from sysid_bench.gap.descent import Fit
from sysid_bench.gap.locate import MOST, explained_by_place, places, promise_of
from sysid_bench.gap.motion import seen
from sysid_bench.gap.pieces import as_wholes
from sysid_bench.gap.problem import Problem
from sysid_bench.gap.suspects import at_places, couplings, on_the_input, on_the_sensors
from sysid_bench.mechanics.effect import Effect

MOST_PLACES = 8
PRIOR_SCALE = 0.7  # of the prior's width: how far from the nominal M, D, K are sought along a motion


def screen(
    problem: Problem,
    fit: Fit,
    catalogue: list[type[Effect]],
    prior_scale: float = PRIOR_SCALE,
    absent: tuple = (),
) -> Screen:
    """Rank every effect of the catalogue, and the decoys, at every place. absent: (name, place) not to be tried."""
    problem, fit = as_wholes(problem, fit)
    seens = [
        seen(problem, fit.point, trace, run, x0)
        for trace, run, x0 in zip(problem.traces, fit.runs, fit.point.starts)
    ]
    b = basis(problem, fit.point, seens, prior_scale)
    by_place = explained_by_place(problem, fit.point, seens, b, prior_scale)
    worth = places(problem.model.n)
    if problem.model.n > 3:
        likely = sorted(by_place, key=lambda place: -by_place[place])[:MOST]
        promise = {place: promise_of(problem, seens, b, place) for place in likely}
        half = MOST_PLACES // 2
        worth = sorted(promise, key=lambda place: -promise[place])[:half]
        worth += [place for place in likely[:half] if place not in worth]
    shelves: list[Shelf | None] = [*at_places(problem, fit.point, seens, b, catalogue, worth)]
    if any(k.name == "missing_coupling" for k in catalogue):
        shelves.append(couplings(problem, seens, b))
    if (
        not problem.held
    ):  # to what a sensor says: that motion cannot tell it wrong, and needs little of a drive
        shelves.append(on_the_input(problem, fit.point, seens, b, catalogue))
        shelves.append(on_the_sensors(problem, seens, b, catalogue))
    filled = [x for x in shelves if x is not None]
    found = [x for one in filled for x in judged(problem, b, one)]
    found = [x for x in found if (x.effect.name, x.place) not in absent]
    found.sort(key=lambda x: -x.score)
    return Screen(found, float(b.r @ b.r), by_place, len(b.r), b.lefts, b, seens, fit.point, filled)
