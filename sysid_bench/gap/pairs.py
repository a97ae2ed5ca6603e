"""screen -> two effects at once: where the best single name is only a compromise between them.

Beside each promising first suspect (its force and what its parameters can change), every other suspect is judged
again on the screen's least squares; the best pairs are polished together and fitted together.
"""

from __future__ import annotations

from dataclasses import dataclass

from sysid_bench.gap.candidates import Candidate, Screen, beside
from sysid_bench.gap.descent import free_parameters
from sysid_bench.gap.polish import Polished, drives, polish, polishable, rows_of
from sysid_bench.gap.problem import Problem
from sysid_bench.mechanics.effect import Effect

FIRSTS, SECONDS = 6, 4  # suspects taken as one of a pair, partners polished with each


@dataclass(frozen=True, eq=False)
class Pair:
    """Two effects and what they explain together along the motion."""

    effects: tuple[Effect, ...]
    polished: Polished
    score: float


def pairs(problem: Problem, screened: Screen, most: int) -> list[Pair]:
    """The best pairs of catalogue effects, best first: each pair of names and places once."""
    firsts = [c for c in screened.candidates if not c.decoy and polishable(c.effect)]
    found: list[Pair] = []
    for first in _distinct(firsts, FIRSTS):
        columns = rows_of(problem, screened, (first.effect,), free_parameters((first.effect,)))
        if columns is None:
            continue
        seconds = [c for c in beside(problem, screened, columns) if not c.decoy and polishable(c.effect)]
        for second in _distinct(seconds, SECONDS):
            if (second.effect.name, second.place) == (first.effect.name, first.place):
                continue
            if any(_same(p.effects, (first.effect, second.effect)) for p in found):
                continue
            together = polish(problem, screened, (first.effect, second.effect), iterations=4)
            if together is not None and drives(problem, together.effects):
                price = first.explained - first.score + second.explained - second.score
                found.append(Pair(together.effects, together, together.explained - price))
    found.sort(key=lambda p: -p.score)
    return found[:most]


def _distinct(candidates: list[Candidate], most: int) -> list[Candidate]:
    """The best shape of each name and place."""
    out: list[Candidate] = []
    for c in candidates:
        if not any(x.effect.name == c.effect.name and x.place == c.place for x in out):
            out.append(c)
        if len(out) == most:
            break
    return out


def _same(one: tuple[Effect, ...], other: tuple[Effect, ...]) -> bool:
    return {(e.name, e.dof) for e in one} == {(e.name, e.dof) for e in other}
