"""train records, test records, model -> the answer: check, refit, locate, name, add, prove."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid_bench.effects import effect_class, names
from sysid_bench.gap.candidates import Screen
from sysid_bench.gap.check_data import DataCheck, check_data, refuse_too_long, refuse_unusable
from sysid_bench.gap.choose import choose
from sysid_bench.gap.choose_on_force import choose_on_force
from sysid_bench.gap.colour import Floor, mean_floor
from sysid_bench.gap.contend import DECOY_NAMES
from sysid_bench.gap.decide import Thresholds, Verdict, decide
from sysid_bench.gap.descent import Fit
from sysid_bench.gap.fineness import finer
from sysid_bench.gap.force import OnForce, admissible, floats, judge_on_force, on_force, with_offset
from sysid_bench.gap.force_screen import screen_on_force
from sysid_bench.gap.free_run import run, shown
from sysid_bench.gap.inverse import ForceProblem
from sysid_bench.gap.problem import Problem, evaluate, frequency_range, problem_of
from sysid_bench.gap.prove import Proof, prove
from sysid_bench.gap.refit import linear_fit
from sysid_bench.gap.screen import screen
from sysid_bench.gap.story import Rules, Story
from sysid_bench.gap.traces import band_end, banded, noise_floor, trace_of
from sysid_bench.mechanics import stepping
from sysid_bench.mechanics.compiled import SECONDS, is_compiled
from sysid_bench.mechanics.effect import Effect
from sysid_bench.mechanics.tangents import tangents
from sysid_bench.nouns import Array, InputError, Model, Record

GREW = 1.01  # times the gap of the model as given, from which the better one's is said to have grown
LOST, WORTH = (
    2.0,
    25.0,
)  # times what the first story leaves, and energy, by which one told anew may lie behind
OTHERWISE = 3.0  # times what the training records promise, from which the test records are said to differ
LOWER = 0.85  # of the noise floor: from which what a fit leaves shows a lower one


@dataclass(frozen=True, eq=False)
class Answer:
    """All that the workflow found. better: the model to go on with; added: its new effects, data faults included."""

    verdict: Verdict
    problem: Problem
    check: DataCheck
    story: Story
    better: Model
    added: tuple[Effect, ...]
    nominal_rho: float
    before: list[Proof]
    after: list[Proof]
    noise: Array
    last_screen: Screen | None = None
    floor_found: str = "from the highest frequencies"
    judged: dict[str, list[OnForce]] | None = (
        None  # of a free mass: given, refitted, better on the test records
    )

    @property
    def force_gaps(self) -> dict[str, float] | None:
        """Mean gap on the force over the test records of the given, the refitted, the better model; and the noise floor."""
        if self.judged is None:
            return None
        return {**{name: self._mean_gap([], name) for name in self.judged}, "floor": self.floor}

    @property
    def gap_before(self) -> float:
        """Held-out error of the model as given: of its free run, or of the force where that is judged."""
        return self._mean_gap(self.before, "given")

    @property
    def gap_after(self) -> float:
        """The same of the better model."""
        return self._mean_gap(self.after, "better")

    @property
    def reason(self) -> str:
        """The verdict's reason; where the test records, which chose nothing, do not bear it out, that too."""
        word, before, after = self.verdict.word, self.gap_before, self.gap_after
        promised = max(1.0, self.nominal_rho) ** 0.5 * self.floor
        if word in ("effect", "parameters") and after > GREW * before:
            told = f"the gap grew from {100 * before:.3g} % to {100 * after:.3g} %: the better model is not proven"
        elif word == "none" and not self.judged and before > OTHERWISE * promised:
            told = (
                f"the gap is {100 * before:.3g} % where noise makes {100 * self.floor:.3g} %: something is in them that "
                "the training records lack (another machine, unit, channel or range)"
            )
        else:
            return self.verdict.reason
        return f"{self.verdict.reason}; but on the test records, which chose nothing, {told}"

    def _mean_gap(self, proofs: list[Proof], which: str) -> float:
        found = [p.gap for p in (self.judged[which] if self.judged else proofs)]
        return float(np.sqrt(np.mean(np.square(found))))

    @property
    def floor(self) -> float:
        """The noise floor on the test records, in the unit of the gap."""
        if self.judged:
            return float(np.mean([j.floor for j in self.judged["better"]]))
        shares = [np.mean(self.noise / np.maximum(np.mean(p.trace.y**2, axis=0), 1e-300)) for p in self.after]
        return float(np.sqrt(np.mean(shares)))


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
    if not model.has_values:
        raise InputError("the gap workflow needs a model with mass, damping and stiffness values.")
    if not (is_compiled(stepping.run) and is_compiled(tangents)):
        tell(f"compiling the simulation, once per machine: some {SECONDS} seconds")
    for records, role in ((train, "train"), (test, "test")):
        refuse_too_long(records, role, model.n)
        refuse_unusable(records, role)
    check = check_data(train)
    for remark in check.remarks:
        tell(remark)
    given = model
    model, faults = with_faults(with_offset(model), check)
    problem, nominal_rho, floor_found = prepared(train, model, check)
    tell(f"the model as given leaves {nominal_rho:.4g} times the noise floor")
    linear = linear_fit(problem)
    if linear is None:
        raise InputError("the model cannot be simulated on these records: its motion leaves every bound.")
    problem, linear = _on_a_lower_floor(problem, linear, check)
    nominal_rho = _nominal_rho(problem)
    tell(f"other M, D, K leave {linear.rho:.4g} times")
    catalogue = admissible([effect_class(name) for name in names()], model) + list(own)
    problem, linear, story = _searched(problem, linear, check, catalogue, rules, tell)
    nominal_rho = _nominal_rho(problem)
    verdict = decide(problem, story, nominal_rho, len(faults), thresholds)
    for effect in story.fit.point.effects[len(model.effects) :]:
        tell(f"with {effect.name} at {effect.dof}: {story.fit.rho:.4g} times")
    better, added = better_model(problem, story, verdict, faults)
    last = _final_screen(problem, story, catalogue) if power else None
    judged = _on_the_force(problem, linear, given, better, test) if problem.on_force else None
    before, after = _proofs(problem, story, (given, better), test, judged)
    floor = np.mean([t.variance for t in problem.traces], axis=0)
    return Answer(
        verdict, problem, check, story, better, added, nominal_rho, before, after, floor, last, floor_found, judged,
    )  # fmt: skip


def _searched(
    problem: Problem, linear: Fit, check: DataCheck, catalogue, rules: Rules, tell
) -> tuple[Problem, Fit, Story]:
    """The story; told anew where what is left shows the noise better than the record did."""
    story = _chosen(problem, linear, catalogue, rules, tell)
    lower = _lower_floor(problem, story.fit, check)
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


def _on_a_lower_floor(problem: Problem, linear: Fit, check: DataCheck) -> tuple[Problem, Fit]:
    """The problem and its refit, on the floor that the refit shows where that is lower."""
    lower = _lower_floor(problem, linear, check)
    again = linear_fit(lower) if lower is not None else None
    return (problem, linear) if lower is None or again is None else (lower, again)


def _lower_floor(problem: Problem, fit: Fit, check: DataCheck) -> Problem | None:
    """The problem on the noise floor of what a fit leaves; None where that is much the same.

    Few samples per period, or hard contacts, and the motion itself still fills the highest frequencies of a record.
    """
    if isinstance(problem, ForceProblem):
        return None
    omega = max(frequency_range(problem.model, t)[1] for t in problem.traces)
    left = [t.y - shown(problem, t, one) for t, one in zip(problem.traces, fit.runs)]
    found = mean_floor([noise_floor(t, r, check.lattice, omega) for t, r in zip(problem.traces, left)])
    present = np.mean([t.variance for t in problem.traces], axis=0)
    if np.all(found.variance > LOWER * present):
        return None
    floor = Floor(np.minimum(found.variance, present), found.phi)
    end = max(band_end(t, floor, omega) for t in problem.traces)
    return problem.on(tuple(banded(t, floor, end) for t in problem.traces))


def _on_the_force(
    problem, linear: Fit, given: Model, better: Model, test: list[Record]
) -> dict[str, list[OnForce]]:
    """The given, the refitted linear and the better model, judged on the force of the test records."""
    refitted = problem.at(linear.point.theta, linear.point.effects)
    models = {"given": given, "refitted": refitted, "better": better}
    found = [judge_on_force(models, r, problem) for r in test]
    return {name: [one[name] for one in found] for name in models}


def with_faults(model: Model, check: DataCheck) -> tuple[Model, tuple[Effect, ...]]:
    """The model with the faults of the data as effects of its sensors, and these effects."""
    made = []
    for fault in check.faults:
        dof = None
        if fault.channel is not None:
            dof = int(np.argmax(np.abs(model.output_map[fault.channel])))
        made.append(effect_class(fault.name)(dof=dof, **fault.parameters))
    shown = [e for e in made if e.name == "sensor_clipping"]  # the others change no prediction worth having
    rest = [e for e in made if e.name != "sensor_clipping"]
    return replace(model, effects=(*model.effects, *shown)), tuple(shown + rest)


def prepared(records: list[Record], model: Model, check: DataCheck) -> tuple[Problem, float, str]:
    """The problem, its noise floor and band set; how far the nominal is from the floor; how that was found."""
    traces = []
    for record, bad in zip(records, check.bad):
        flagged = replace(
            record,
            quality=np.where(
                bad, np.maximum(record.quality if record.quality is not None else 0, 1), 0
            ).astype(np.uint8),
        )
        traces.append(trace_of(flagged, model))
    traces = tuple(traces)
    problem = problem_of(model, traces)
    if floats(model):
        problem, how = on_force(problem, check.lattice)
        return problem, _nominal_rho(problem), how
    omega = max(frequency_range(model, t)[1] for t in traces)
    noise = _floor(problem, check.lattice, omega)
    end = max(band_end(t, noise, omega) for t in traces)
    traces = tuple(banded(t, noise, end) for t in traces)
    problem, how = problem.on(traces), "from the highest frequencies"
    return problem, _nominal_rho(problem), how


def _nominal_rho(problem: Problem) -> float:
    found = evaluate(problem, problem.nominal())
    return float(found[0] @ found[0] / len(found[0])) if found is not None else np.inf


def _floor(problem: Problem, lattice: Array, omega: float) -> Floor:
    """Noise over all traces: per channel the smaller of what the nominal leaves and what y itself shows on high."""
    point = problem.nominal()
    model = problem.model_at(point)
    parts = []
    for trace, x0 in zip(problem.traces, point.starts):
        own = noise_floor(trace, trace.y, lattice, omega)
        y = shown(problem, trace, run(problem, trace, model, x0))
        parts.append(
            own.smaller(noise_floor(trace, trace.y - y, lattice, omega)) if np.isfinite(y).all() else own
        )
    return mean_floor(parts)


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
