"""train records, test records, model -> the answer: check, refit, locate, name, add, prove."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sysid_bench.effects import effect_class, names
from sysid_bench.gap.answer import Answer
from sysid_bench.gap.candidates import Screen
from sysid_bench.gap.check_data import (
    DataCheck,
    check_data,
    refuse_too_long,
    refuse_too_slow,
    refuse_unusable,
)
from sysid_bench.gap.choose import choose
from sysid_bench.gap.choose_on_force import choose_on_force
from sysid_bench.gap.decide import Verdict, decide
from sysid_bench.gap.descent import Fit
from sysid_bench.gap.fineness import finer
from sysid_bench.gap.force import OnForce, admissible, judge_on_force
from sysid_bench.gap.force_screen import screen_on_force
from sysid_bench.gap.inverse import ForceProblem
from sysid_bench.gap.lost import FIRST, lost, told_anew
from sysid_bench.gap.prepare import (
    lower_floor,
    nominal_rho_of,
    on_a_lower_floor,
    prepared,
    with_faults,
    within_steps,
)
from sysid_bench.gap.price import DECOY_NAMES
from sysid_bench.gap.problem import Problem, evaluate, frequency_range
from sysid_bench.gap.prove import Proof, prove
from sysid_bench.gap.refit import linear_fit
from sysid_bench.gap.screen import screen
from sysid_bench.gap.story import Rules, Story
from sysid_bench.gap.thresholds import Thresholds
from sysid_bench.mechanics import stepping
from sysid_bench.mechanics.compiled import SECONDS, is_compiled
from sysid_bench.mechanics.effect import Effect
from sysid_bench.mechanics.tangents import tangents
from sysid_bench.nouns import InputError, Model, Record

LOST = 2.0  # times what the first story leaves, and
WORTH = 25.0  # energy beyond it, by which one told anew may lie behind


def find_gap(
    train: list[Record],
    test: list[Record],
    model: Model,
    own: tuple[type[Effect], ...] = (),
    rules: Rules | None = None,
    thresholds: Thresholds | None = None,
    tell: Callable[[str], Any] = lambda line: None,
    power: bool = True,
) -> Answer:
    """Name what is missing in a model, from the train records; prove it on the test records, which choose nothing.

    own: effect classes of the user's, tried beside the catalogue. Raises InputError where records and model do not fit.
    """
    rules, thresholds = rules or Rules(), thresholds or Thresholds()
    check = _checked(train, test, model, tell)
    given = model
    model, faults = with_faults(model, check)
    problem, nominal_rho, floor_found = prepared(train, model, check)
    tell(f"the model as given leaves {nominal_rho:.4g} times the noise floor")
    linear = linear_fit(problem)
    if linear is None:
        raise InputError("the model cannot be simulated on these records: its motion leaves every bound.")
    problem, linear = on_a_lower_floor(problem, linear, check)
    nominal_rho = nominal_rho_of(problem)
    tell(f"other M, D, K leave {linear.rho:.4g} times")
    catalogue = admissible([effect_class(name) for name in names()], problem) + list(own)
    problem, linear, story = _searched(problem, linear, check, catalogue, rules, tell)
    nominal_rho = nominal_rho_of(problem)
    verdict = decide(problem, story, nominal_rho, len(faults), thresholds)
    if (
        verdict.word == "unknown"
        and faults
        and not problem.on_force
        and within_steps(problem, linear, check.lattice)
    ):
        story = Story(linear, linear)  # the fault of the data is all that the records show
        verdict = decide(problem, story, nominal_rho, len(faults), thresholds)
    if lost(verdict.word, story.fit, linear) and not (faults or problem.on_force):
        near = replace(rules, first_share=FIRST)
        choose = partial(_chosen, catalogue=catalogue, rules=near, tell=tell)
        judge = partial(decide, nominal_rho=nominal_rho, faults=0, thresholds=thresholds)
        told = told_anew(problem, linear, choose, judge, tell)
        problem, story, verdict = told or (problem, story, verdict)
    for effect in story.fit.point.effects[len(problem.effects) :]:
        tell(f"with {effect.name} at {effect.dof}: {story.fit.rho:.4g} times")
    better, added = better_model(problem, story, verdict, faults)
    last = _final_screen(problem, story, catalogue) if power else None
    judged = _on_the_force(problem, linear, given, better, test) if problem.on_force else None
    before, after = _proofs(problem, story, (given, better), test, judged)
    omega = max(frequency_range(problem.model, t)[1] for t in problem.traces)
    noise = [p.noise(check.lattice, omega) for p in after]
    return Answer(
        verdict, problem, check, story, better, added, nominal_rho, before, after, noise, last, floor_found, judged,
    )  # fmt: skip


def _checked(train: list[Record], test: list[Record], model: Model, tell) -> DataCheck:
    """What the training records' data are like. Raises InputError where records or model cannot be judged."""
    if not model.has_values:
        raise InputError("the gap workflow needs a model with mass, damping and stiffness values.")
    if not (is_compiled(stepping.run) and is_compiled(tangents)):
        tell(f"compiling the simulation, once per machine: some {SECONDS} seconds")
    for records, role in ((train, "train"), (test, "test")):
        refuse_too_long(records, role, model.n)
        refuse_unusable(records, role)
        refuse_too_slow(records, role, model)
    check = check_data(train)
    for remark in check.remarks:
        tell(remark)
    return check


def _searched(
    problem: Problem, linear: Fit, check: DataCheck, catalogue, rules: Rules, tell
) -> tuple[Problem, Fit, Story]:
    """The story; told anew where what is left shows the noise better than the record did."""
    story = _chosen(problem, linear, catalogue, rules, tell)
    lower = lower_floor(problem, story.fit, check)
    if lower is not None and not problem.budget.spent:
        again = linear_fit(lower) or linear
        retold = _chosen(lower, again, catalogue, rules, tell)
        if not _lost(lower, story.fit, retold.fit):
            problem, linear, story = lower, again, retold
    if problem.budget.spent:
        tell(
            "the search ended early: its budget of simulated steps is spent; what follows is the best answer so far"
        )
    return problem, linear, story


def _lost(problem: Problem, first: Fit, later: Fit) -> bool:
    """True where a search that started anew, with less budget, ends farther from the data than the first one did."""
    found, R = evaluate(problem, first.point), len(later.rows)
    return found is not None and later.rss - R > LOST * max(float(found[0] @ found[0]) - R, 0.0) + WORTH


def _proofs(
    problem: Problem, story: Story, models: tuple[Model, Model], test: list[Record], judged
) -> tuple[list[Proof], list[Proof]]:
    """Free runs over the test records of the model as given and of the better one."""
    if judged is None:
        fine = finer(problem, story.fit.point).fineness
        before, after = ([prove(model, r, fineness=fine) for r in test] for model in models)
        return before, after
    # a drifting position tells little of a phase: it is known from the force
    before, after = (
        [prove(j.model, r, frozenset()) for j, r in zip(judged[which], test)] for which in ("given", "better")
    )
    return before, after


def _chosen(problem: Problem, linear: Fit, catalogue, rules: Rules, tell) -> Story:
    """The story of the missing effects; without any where the search breaks down."""
    try:
        if isinstance(problem, ForceProblem):
            return choose_on_force(problem, linear, catalogue, rules)
        return choose(problem, linear, catalogue, rules)
    except np.linalg.LinAlgError as trouble:  # a singular normal matrix: what the refit says still holds
        tell(f"the search for effects ended early ({trouble})")
        return Story(linear, linear)


def _on_the_force(
    problem, linear: Fit, given: Model, better: Model, test: list[Record]
) -> dict[str, list[OnForce]]:
    """The given, the refitted linear and the better model, judged on the force of the test records."""
    refitted = problem.at(linear.point.theta, linear.point.effects)
    models = {"given": given, "refitted": refitted, "better": better}
    found = [judge_on_force(models, r, problem) for r in test]
    return {name: [one[name] for one in found] for name in models}


def better_model(
    problem: Problem, story: Story, verdict: Verdict, faults
) -> tuple[Model, tuple[Effect, ...]]:
    """The model to go on with. `none` keeps the model as given; `unknown` adds no effect: M, D, K as refitted."""
    given = problem.model
    base = len(given.effects)
    if verdict.word == "none":
        return given, tuple(faults)
    fit: Fit = story.fit
    effects = list(fit.point.effects)
    unnamed = any(e.name in DECOY_NAMES for e in effects)
    if unnamed or (verdict.word == "unknown" and not problem.on_force):
        fit = story.linear
        effects = list(fit.point.effects)
    M, D, K = problem.matrices(fit.point.theta)
    hold = given.hold
    for e in effects:
        if e.name == "wrong_hold":
            hold = getattr(e, "hold", hold)
    kept = tuple(e for e in effects if e.name != "wrong_hold")
    better = replace(given, mass=M, damping=D, stiffness=K, effects=kept, hold=hold)
    new = tuple(effects[base:])
    return better, (*new, *faults)


def _final_screen(problem: Problem, story: Story, catalogue) -> Screen | None:
    """One more look, to say what would have been seen: power."""
    if story.rounds and story.rounds[-1].chosen is None:
        return story.rounds[-1].screen
    if isinstance(problem, ForceProblem):
        return screen_on_force(problem, story.fit, catalogue)
    return screen(problem, story.fit, catalogue)
