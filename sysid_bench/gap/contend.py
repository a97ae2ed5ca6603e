"""suspect -> contender: the suspect fitted by free-run simulation jointly with everything."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from sysid_bench.gap.candidates import Candidate
from sysid_bench.gap.descent import Fit, fit, free_parameters
from sysid_bench.gap.finalists import relatives
from sysid_bench.gap.free_run import SMOOTH
from sysid_bench.gap.motion import seen
from sysid_bench.gap.nudge import leads
from sysid_bench.gap.price import CLOSED, DECOY_NAMES, Contender, price
from sysid_bench.gap.problem import Point, Problem, evaluate
from sysid_bench.mechanics.effect import Effect, direction

SHUT = 1.02  # rho below which a fit leaves nothing
ALIKE = 0.1  # share of a value by which starts differ that are one
BEHIND = 1.5, 0.1  # times the lowest rho of a name, and beyond: what leaves more is no rival


def best_start(problem: Problem, choices: list[Point]) -> tuple[float, Point] | None:
    """The point whose run, of one step per sample, lies nearest to the data, and its rho."""
    best, quick = None, replace(problem, quick=True)
    for point in choices:
        found = evaluate(quick, point)
        if found is not None:
            rho = float(found[0] @ found[0]) / len(found[0])
            if best is None or rho < best[0]:
                best = (rho, point)
    return best


@dataclass(eq=False)
class Arena:
    """Where suspects are fitted: the problem, the fit before, the same problem held near the motion (leads).

    nearest: the lowest rho so far of fits that were held, per lead; closed: a name closes the gap already
    least: the lowest rss so far of a name; known: contenders of an earlier look from the same fit
    leads_left: suspects that may still be led; fewer once a shape without a name closes the gap
    straight: nothing is led; begun: contenders of such an arena from the same fit and suspects
    """

    problem: Problem
    base: Fit
    held: tuple[Problem, ...] = ()
    nearest: list[float] = field(default_factory=lambda: [np.inf, np.inf])
    closed: bool = False
    least: float = np.inf
    leads_left: int = 5
    known: list[Contender] = field(default_factory=list)
    straight: bool = False
    begun: list[Contender] = field(default_factory=list)

    def contender(self, found: Fit, candidate: Candidate) -> Contender:
        """A fit and its price."""
        if candidate.effect.name not in DECOY_NAMES:
            self.least = min(self.least, found.rss)
        if found.rho < 1.1 and candidate.effect.name in DECOY_NAMES:
            self.leads_left = min(self.leads_left, 2)
        elif found.rho < 1.1:
            self.closed = True
        return Contender(found, candidate, price(self.problem, found))

    @property
    def enough(self) -> float:
        """Energy above which a fit is no rival of what was found."""
        return BEHIND[0] * self.least + BEHIND[1] * len(self.base.rows)


def refine(
    arena: Arena, candidate: Candidate, promised: float, extra: tuple[Effect, ...] = (), iterations: int = 12
) -> Contender | None:
    """Fit by free-run simulation, jointly with everything; by way of held simulations where that is not straightforward.

    promised: rho that the screen expects; extra: effects tried together with the candidate's. None where it fails.
    """
    if arena.problem.budget.spent:
        return None
    for one in arena.known:
        if alike(one.candidate.effect, candidate.effect):
            return arena.contender(one.fit, one.candidate)
    base = arena.base
    before = (*base.point.effects, *extra)
    choices = [
        Point(np.asarray(theta, dtype=float), (*before, effect), starts)
        for effect in (candidate.effect, candidate.origin)
        if effect is not None
        for theta in (
            candidate.theta,
            np.zeros_like(base.point.theta),
            *([base.point.theta] if before else []),
        )
        for starts in (base.point.starts, arena.problem.begins)  # a fit without it bent its own to swallow it
    ]
    begun = next((one.fit for one in arena.begun if one.candidate is candidate), None)
    found = _descended(arena, choices, promised, iterations, begun)
    if found is None or _no_turn(arena.problem, found):
        return None
    return arena.contender(found, candidate)


def _no_turn(problem: Problem, found: Fit) -> bool:
    """True where the last effect is a wave that makes no turn: a tone in the longest record, which is then a drift;
    a ripple over the travel at its place, which is then a spring."""
    effect = found.point.effects[-1]
    if effect.name == "periodic_disturbance":
        return effect.value("frequency") * max(t.N * t.h for t in problem.traces) < 1
    if effect.name == "position_ripple":
        c = direction(effect.dof, problem.model.n)
        travel = max(float(np.ptp(run.X[:, : len(c)] @ c)) for run in found.runs)
        return effect.value("pitch") > travel
    return False


def alike(one: Effect, other: Effect) -> bool:
    """True for the same name and place with nearly the same values: descents from there end in the same valley."""
    if (one.name, one.dof) != (other.name, other.dof) or one.numeric != other.numeric:
        return False
    shapes = [key not in ("speed", "damping") for key in one.numeric]
    a, b = one.values[shapes], other.values[shapes]
    return bool(np.all(np.abs(a - b) <= ALIKE * np.maximum(np.abs(a), np.abs(b))))


def _descended(
    arena: Arena, choices: list[Point], promised: float, iterations: int, begun: Fit | None = None
) -> Fit | None:
    """The fit from the best of some starts: straight, and by way of the held problems where that leaves something.

    begun: the straight one, where it is known
    """
    free, found = free_parameters(choices[0].effects), begun
    may = arena.held and not arena.closed and arena.leads_left > 0
    rough = bool(may) and _has_corners(choices[0].effects)
    start = best_start(arena.problem, choices) if begun is None else None
    if start is not None and (not rough or start[0] < 3 * promised + 1):
        found = fit(arena.problem, start[1], free, iterations, enough=arena.enough)
    if rough and not arena.straight and (found is None or found.rho > CLOSED):
        arena.leads_left -= 1
        led = _led(arena, choices, free, iterations)
        if led is not None and (found is None or led.rss < found.rss):
            found = led
    return found


def _has_corners(effects: tuple[Effect, ...]) -> bool:
    """True where a law switches: there a free run's error is a rough function of the parameters."""
    return any(e.path == "force" and e.name not in SMOOTH and e.name not in DECOY_NAMES for e in effects)


def _led(arena: Arena, choices: list[Point], free, iterations: int) -> Fit | None:
    """By way of the held problems; given up where another suspect is far nearer there."""
    start = best_start(arena.held[0], choices)
    if start is None:
        return None
    point = start[1]
    for k, problem in enumerate(arena.held):
        found = fit(problem, point, free, 8 - 3 * k)
        if found is None:
            return None
        arena.nearest[k] = min(arena.nearest[k], found.rho)
        if found.rho > 3 * arena.nearest[k] + 0.5:
            return None
        point = found.point
    return fit(arena.problem, point, free, iterations, enough=arena.enough)


def settled(problem: Problem, one: Fit, along: Fit, iterations: int = 12) -> Fit:
    """A fit of laws that switch, led once more along the motion that another fit shows; itself where that is no nearer."""
    if problem.on_force or one.rho < CLOSED or not _has_corners(one.point.effects):
        return one
    seens = [
        seen(problem, along.point, *each) for each in zip(problem.traces, along.runs, along.point.starts)
    ]
    held = leads(problem, seens)
    led = _led(Arena(problem, one, held), [one.point], one.parameters, iterations) if held else None
    return led if led is not None and led.rss < one.rss else one


def kindred(arena: Arena, one: Contender, known: set, iterations: int = 10) -> list[Contender]:
    """Other frictions in place of a friction that was fitted, a coupling in place of a stop; each from the best of a few starts.

    Where the gap is closed, only the simpler and the richer law of the same sliding friction can still matter.
    """
    effect = one.effect
    if arena.problem.budget.spent:
        return []
    out, point = [], one.fit.point
    for name, starts in relatives(arena.problem, one.fit, effect).items():
        if (name, effect.dof) in known or (one.fit.rho < SHUT and name == "presliding_friction"):
            continue
        choices = [replace(point, effects=(*point.effects[:-1], other)) for other in starts]
        found = _descended(arena, choices, one.fit.rho, iterations)
        if found is not None:
            out.append(arena.contender(found, replace(one.candidate, effect=found.point.effects[-1])))
    return out
