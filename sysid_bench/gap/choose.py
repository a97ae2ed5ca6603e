"""linear fit, catalogue -> the effects that are missing, one after the other, and what nearly won.

Greedy: screen, fit the best few by free-run simulation jointly with M, D, K, keep the cheapest explanation; then
look again. A second effect must earn its place; what became unnecessary is dropped.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from sysid_bench.gap.decoys import DECOYS
from sysid_bench.gap.force_screen import screen_on_force
from sysid_bench.gap.held_out import block_losses, earns_on_force, held_out_cost, simplest
from sysid_bench.gap.problem import Fit, Point, Problem, evaluate, fit, free_parameters
from sysid_bench.gap.screen import Candidate, Screen, screen
from sysid_bench.mechanics.effect import Effect

DECOY_NAMES = frozenset(kind.name for kind in DECOYS)


UNCLEAN = 0.05  # share of the linear gap above which an unnamed shape has not explained it
MOST_DAMPED = 0.7  # damping ratio from which a hidden mass is no mode
BATCHES = 3  # of finalists, where the screen promises what no fit keeps


@dataclass(frozen=True)
class Rules:
    """How an effect earns its place.

    most (most_on_force where the force is judged): effects looked for; finalists: suspects fitted by simulation; practical: share of the linear gap that
    matters; second_share: share of what is left that a later effect must take; enough: rho at which nothing is left
    """

    most: int = 3
    most_on_force: int = 4
    finalists: int = 7
    practical: float = 0.03
    second_share: float = 0.4
    enough: float = 1.05


@dataclass(frozen=True, eq=False)
class Contender:
    """A fit with one more effect, and what it costs: 2 rss + parameters ln R + what M, D, K moved."""

    fit: Fit
    candidate: Candidate
    cost: float

    @property
    def effect(self) -> Effect:
        return self.fit.point.effects[-1]

    @property
    def is_decoy(self) -> bool:
        return self.effect.name in DECOY_NAMES


@dataclass(frozen=True, eq=False)
class Round:
    """One look: the screen, the contenders (cheapest first), the fit before and the one chosen (None: nothing)."""

    screen: Screen
    contenders: list[Contender]
    before: Fit
    chosen: Contender | None


@dataclass(eq=False)
class Story:
    """linear: the refit without effects; fit: where it ends; rounds: what was looked at on the way."""

    linear: Fit
    fit: Fit
    rounds: list[Round] = field(default_factory=list)

    @property
    def ends_unnamed(self) -> bool:
        """True where a shape without a name is part of the explanation."""
        return any(e.name in DECOY_NAMES for e in self.fit.point.effects)


def shape_count(effects: tuple[Effect, ...]) -> int:
    """Parameters that count: not the smoothing of a sign, not the loss of a contact."""
    return sum(effects[e].numeric[p] not in ("speed", "damping") for e, p in free_parameters(effects))


def suspects_of(problem: Problem, base: Fit, catalogue) -> Screen:
    """The screen that suits the problem: by filtered forces, or on the force itself."""
    return (screen_on_force if problem.on_force else screen)(problem, base, catalogue)


def price(problem: Problem, one: Fit) -> float:
    """2 rss + parameters ln R + the squared step of theta: only a trusted nominal splits forces that are alike.

    On the force, where what is left is never noise: twice the loss on held-out blocks.
    """
    if problem.on_force:
        return held_out_cost(problem, one)
    R = len(one.rows)
    moved = 0.09 * one.moved / 0.01  # in units of a tenth of each prior-weighted entry, weighed 0.3
    count = shape_count(one.point.effects)
    return 2 * one.rss + count * np.log(R) + 0.3 * moved


def best_start(problem: Problem, effects: tuple[Effect, ...], thetas: list, starts) -> Point | None:
    """The start whose free run lies nearest to the data."""
    best = None
    for theta in thetas:
        point = Point(np.asarray(theta, dtype=float), effects, starts)
        found = evaluate(problem, point)
        if found is not None and (best is None or found[0] @ found[0] < best[0]):
            best = (found[0] @ found[0], point)
    return best[1] if best else None


def refine(problem: Problem, base: Fit, candidate: Candidate, iterations: int = 12) -> Contender | None:
    """Fit one more effect by free-run simulation, jointly with everything. None where it fails or ends inadmissible."""
    effects = (*base.point.effects, candidate.effect)
    thetas = [base.point.theta, candidate.theta, np.zeros_like(base.point.theta)]
    start = best_start(problem, effects, thetas, base.point.starts)
    found = fit(problem, start, free_parameters(effects), iterations) if start is not None else None
    if found is None or (problem.on_force and _swings_not(found.point.effects[-1])):
        return None
    return Contender(found, candidate, price(problem, found))


def _swings_not(effect: Effect) -> bool:
    """True of a hidden mass that creeps: a mode by name only, and on a machine it mends the shape of anything."""
    return effect.name == "extra_mode" and effect.values[effect.numeric.index("damping_ratio")] > MOST_DAMPED


def _rank(one: Fit, effect: Effect) -> tuple:
    """Names before shapes without one, few parameters before many; a lag only where its loss of gain is seen."""
    return effect.name in DECOY_NAMES, shape_count(one.point.effects), effect.name == "actuator_lag"


def shortlist(screened: Screen, most: int) -> list[Candidate]:
    """Suspects worth a simulation: at least half of the best, two places per name, one of each at a place."""
    out: list[Candidate] = []
    if not screened.candidates:
        return out
    best = screened.candidates[0].explained
    for c in screened.candidates:
        if c.explained < max(0.5 * best, 15) or len(out) >= most:
            break
        family = "decoy" if c.decoy else c.effect.name
        same = [x for x in out if ("decoy" if x.decoy else x.effect.name) == family]
        if len(same) >= 2 or any(x.effect.name == c.effect.name and x.place == c.place for x in out):
            continue
        out.append(c)
    out += _located(screened, out)
    return out + _relatives(screened, out)


def _located(screened: Screen, chosen: list[Candidate]) -> list[Candidate]:
    """Where a force at one place, and no other, would explain it all, that place's best names are tried too.

    Friction that sticks is seen so: no regressor shows it, for the motion is zero.
    """
    ranked = sorted(screened.by_place.items(), key=lambda item: -item[1])
    if len(ranked) < 2 or ranked[0][1] < 0.9 or (1 - ranked[0][1]) > 0.3 * (1 - ranked[1][1]):
        return []
    if chosen[0].explained > 0.9 * screened.left:
        return []
    out: list[Candidate] = []
    for c in screened.candidates:
        known = any(x.effect.name == c.effect.name and x.place == c.place for x in (*chosen, *out))
        if c.place == ranked[0][0] and not c.decoy and not known and len(out) < 3:
            out.append(c)
    return out


def _relatives(screened: Screen, chosen: list[Candidate]) -> list[Candidate]:
    """Stribeck and presliding friction beside a suspected Coulomb friction: they differ only at low speed."""
    out = []
    for c in [x for x in chosen if x.effect.name == "coulomb_friction"][:1]:
        for name in ("stribeck_friction", "presliding_friction"):
            if any(x.effect.name == name and x.place == c.place for x in chosen):
                continue
            out += [x for x in screened.candidates if x.effect.name == name and x.place == c.place][:1]
    return out


def cheapest(contenders: list[Contender], linear_gap: float, rules: Rules) -> Contender | None:
    """The lowest price; a simpler catalogue effect that is nearly as good wins over a decoy or a richer one."""
    if not contenders:
        return None
    best = contenders[0]
    margin = max(20.0, rules.practical * linear_gap)
    count = shape_count(best.fit.point.effects)
    for other in contenders[1:]:
        behind = other.cost - best.cost
        if behind > margin or other.fit.rho > 1.4 * best.fit.rho + 0.1:
            break
        simpler = shape_count(other.fit.point.effects) < count
        named = best.is_decoy and not other.is_decoy and behind < max(20.0, margin / 3)
        if named or (simpler and not other.is_decoy and _subset(other.effect, best.effect)):
            return other
    return best


def _subset(simple: Effect, rich: Effect) -> bool:
    """True where the simple effect is the rich one with a parameter at its limit, at the same place."""
    pairs = {
        ("coulomb_friction", "stribeck_friction"), ("coulomb_friction", "presliding_friction"),
        ("coulomb_friction", "bouc_wen_hysteresis"), ("sensor_bias", "sensor_drift"),
        ("coulomb_friction", "friction_behind_play"), ("presliding_friction", "friction_behind_play"),
    }  # fmt: skip
    return simple.dof == rich.dof and (simple.name, rich.name) in pairs


def look(problem: Problem, base: Fit, catalogue, rules: Rules, linear_gap: float) -> Round:
    """One screen and its finalists."""
    ground = _ground(problem, base)
    screened = suspects_of(problem, ground, catalogue)
    R = len(base.rows)
    if not screened.candidates or screened.candidates[0].explained < 30 + 4 * np.log(R):
        return Round(screened, [], base, None)
    finalists = rules.finalists if problem.model.n < 6 else max(3, rules.finalists - 3)
    contenders: list[Contender] = []
    rest = screened
    for _ in range(BATCHES):
        tried = shortlist(rest, finalists)
        contenders += _fitted(problem, base, tried, contenders)
        if not tried or _as_promised(base, contenders, screened):
            break
        names = {c.effect.name for c in tried}
        rest = replace(rest, candidates=[c for c in rest.candidates if c.effect.name not in names])
    contenders.sort(key=lambda c: c.cost)
    pick = _simplest(problem, contenders, rules) if problem.on_force else None
    return Round(screened, contenders, base, pick or cheapest(contenders, linear_gap, rules))


def _simplest(problem, contenders: list[Contender], rules: Rules) -> Contender | None:
    """On the force: the fewest parameters, and a name before none, of those that held-out blocks find as good."""
    if not contenders:
        return None
    losses = [block_losses(problem, c.fit) for c in contenders]
    best = contenders[int(np.argmin([x.sum() for x in losses]))]
    related = [_subset(c.effect, best.effect) for c in contenders]
    ranks = [_rank(c.fit, c.effect) for c in contenders]
    return contenders[simplest(losses, ranks, related, (rules.second_share, rules.practical))]


def _fitted(problem: Problem, base: Fit, tried: list[Candidate], before: list[Contender]) -> list[Contender]:
    found: list[Contender] = []
    for candidate in tried:
        clean = any(c.fit.rho < 1.1 and not c.is_decoy for c in (*before, *found))
        if clean and candidate.explained < 0.9 * tried[0].explained:
            continue  # something closes the gap already, and this one is far behind
        one = refine(problem, base, candidate)
        if one is not None:
            found.append(one)
    return found


def _as_promised(base: Fit, contenders: list[Contender], screened: Screen) -> bool:
    """True where some fit keeps half of what its screen promised; else the screen was misled and the next are tried."""
    left = max(base.rss - len(base.rows), 1.0)
    share = [(base.rss - c.fit.rss) / left for c in contenders]
    promised = [min(c.candidate.explained / max(screened.left, 1e-9), 1.0) for c in contenders]
    return any(s > 0.5 * p for s, p in zip(share, promised))


def _ground(problem: Problem, base: Fit) -> Fit:
    """Where to screen from: the nominal parameters where the refit bent them to swallow a strong effect."""
    if problem.on_force or base.rho < 20 or np.max(np.abs(base.point.theta / problem.prior)) < 1.1:
        return base
    point = replace(base.point, theta=np.zeros_like(base.point.theta))
    found = evaluate(problem, point)
    return base if found is None else replace(base, point=point, rows=found[0], runs=found[1])


def earns(problem: Problem, before: Fit, after: Fit, linear: Fit, first: bool, rules: Rules) -> bool:
    """True where an effect takes enough of what is left."""
    if problem.on_force:
        return earns_on_force(problem, before, after, rules.practical)
    R = len(before.rows)
    gain, left, linear_gap = before.rss - after.rss, before.rss - R, max(linear.rss - R, 1.0)
    if gain < 25:
        return False
    if first:
        return True
    clean = after.rho < 1.3 and gain > 0.7 * left and gain > 5 * np.sqrt(2 * R)
    return gain > rules.second_share * max(left, 0) and (gain > rules.practical * linear_gap or clean)


def choose(problem: Problem, linear: Fit, catalogue: list[type[Effect]], rules: Rules | None = None) -> Story:
    """The story of the missing effects. Pure: nothing but its arguments decides."""
    rules = rules or Rules()
    story = Story(linear, linear)
    linear_gap = max(linear.rss - len(linear.rows), 1.0)
    first = look(problem, linear, catalogue, rules, linear_gap)
    story = _told(problem, story, first, catalogue, rules)
    shape = first.chosen
    if shape is None or not shape.is_decoy or (shape.fit.rss - len(shape.fit.rows)) < UNCLEAN * linear_gap:
        return story
    # No single force explains it: an unnamed shape may stand for the sum of two named ones.
    named = next((c for c in first.contenders if not c.is_decoy), None)
    if named is None:
        return story
    other = _told(problem, Story(linear, linear), replace(first, chosen=named), catalogue, rules)
    return other if other.fit.rho < 1.3 and not other.ends_unnamed else story


def _told(problem: Problem, story: Story, first: Round, catalogue, rules: Rules) -> Story:
    """The story that follows from a first look: every later effect must earn its place."""
    linear = story.linear
    linear_gap = max(linear.rss - len(linear.rows), 1.0)
    for k in range(rules.most_on_force if problem.on_force else rules.most):
        if story.fit.rho < rules.enough and k > 0:
            break
        round_ = first if k == 0 else look(problem, story.fit, catalogue, rules, linear_gap)
        chosen = round_.chosen
        if chosen is not None and problem.on_force and chosen.is_decoy and k > 0:
            # on a machine some shape always fits what is left a little; the names that earn their place come first
            chosen = _simplest(problem, [c for c in round_.contenders if not c.is_decoy], rules)
        if chosen is not None and not earns(problem, story.fit, chosen.fit, linear, k == 0, rules):
            chosen = None
        story.rounds.append(replace(round_, chosen=chosen))
        if chosen is None:
            break
        story.fit = chosen.fit
        if chosen.is_decoy:
            break
        if k > 0:
            story.fit = _reconsidered(problem, story.fit, catalogue, rules, linear_gap)
            story.fit = _pruned(problem, story.fit, rules)
    return story


def _reconsidered(problem: Problem, now: Fit, catalogue, rules: Rules, linear_gap: float) -> Fit:
    """Name each earlier effect again, given the others."""
    for k in range(len(problem.model.effects), len(now.point.effects) - 1):
        effects = now.point.effects
        rest = tuple(x for i, x in enumerate(effects) if i != k)
        without = fit(problem, replace(now.point, effects=rest), free_parameters(rest), iterations=6)
        if without is None or without.rss - now.rss < 25:
            continue
        rank = _rank(now, effects[k])
        screened = suspects_of(problem, without, catalogue)
        best = price(problem, now)
        for candidate in shortlist(screened, 4):
            if candidate.effect.name == effects[k].name and candidate.place == effects[k].dof:
                continue
            other = refine(problem, without, candidate, iterations=8)
            if other is None:
                continue
            margin = max(20, (2 * rules.practical if problem.on_force else 0.1) * (now.rss - len(now.rows)))
            if problem.on_force and _rank(other.fit, other.effect) > rank:
                continue  # on a machine a richer shape always gains a little
            simpler = shape_count(other.fit.point.effects) < shape_count(now.point.effects)
            if other.cost < best + (margin if simpler and not other.is_decoy else -margin):
                now, best = other.fit, other.cost
    return now


def _pruned(problem: Problem, now: Fit, rules: Rules) -> Fit:
    """Drop effects that the others have made unnecessary."""
    base = len(problem.model.effects)
    for effect in now.point.effects[base:]:
        if len(now.point.effects) < base + 2 or effect not in now.point.effects:
            continue
        rest = tuple(x for x in now.point.effects if x is not effect)
        without = fit(problem, replace(now.point, effects=rest), free_parameters(rest), iterations=6)
        if without is not None and _unnecessary(problem, without, now, rules):
            now = without
    return now


def _unnecessary(problem: Problem, without: Fit, now: Fit, rules: Rules) -> bool:
    if problem.on_force:
        return not earns_on_force(problem, without, now, rules.practical)
    return without.rss - now.rss < max(25, 0.3 * max(now.rss - len(now.rows), 0))
