"""How suspects are fitted: polished along the motion, held near it, judged in pairs; on records from the trials' engine."""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from sysid_bench.effects import effect_class, names
from sysid_bench.gap import again, refit
from sysid_bench.gap.again import pruned, reconsidered
from sysid_bench.gap.candidates import Candidate
from sysid_bench.gap.check_data import check_data
from sysid_bench.gap.colour import Floor
from sysid_bench.gap.contend import Arena, _no_turn, kindred, refine
from sysid_bench.gap.descent import Fit, fit, free_parameters
from sysid_bench.gap.finalists import polished_screen, shortlist
from sysid_bench.gap.lost import lost
from sysid_bench.gap.nudge import leads
from sysid_bench.gap.pairs import pairs
from sysid_bench.gap.pieces import as_wholes, in_pieces, wholes
from sysid_bench.gap.polish import drives, polished_candidate
from sysid_bench.gap.prepare import prepared
from sysid_bench.gap.price import GAP_GAINS, RICHER_GAINS, TIE, Contender, cheapest
from sysid_bench.gap.problem import Budget, Point, evaluate
from sysid_bench.gap.refit import linear_fit
from sysid_bench.gap.screen import screen
from sysid_bench.gap.story import Round, Story
from sysid_bench.gap.traces import banded, trace_of
from sysid_bench.gap.unexplained import where_values
from sysid_bench.gap.workflow import find_gap
from sysid_bench.nouns import Model, Record

TRIALS = Path(__file__).parents[1] / "experiments" / "hidden_effects"
CATALOGUE = [effect_class(name) for name in names()]


@pytest.fixture(scope="module")
def draw():
    sys.path.insert(0, str(TRIALS))
    import draw

    yield draw.Draw
    sys.path.remove(str(TRIALS))


def problem_and_screen(draw, seed, **given):
    trial = draw(seed, **given).trial()
    model = Model(
        trial.M, trial.D, trial.K, input_map=trial.L, hold=trial.hold, initial_state=trial.initial_state
    )
    u, y = trial.train
    record = Record(np.arange(len(u)) * trial.h, u, y, hold=trial.hold)
    problem = prepared([record], model, check_data([record]))[0]
    linear = linear_fit(problem)
    return problem, linear, screen(problem, linear, CATALOGUE), trial.truth["effects"]


def test_a_refit_near_the_noise_goes_on_until_nothing_is_left_to_gain(draw, monkeypatch):
    trial = draw(7, size="three", kind="parameters").trial()
    model = Model(
        trial.M, trial.D, trial.K, input_map=trial.L, hold=trial.hold, initial_state=trial.initial_state
    )
    u, y = trial.train
    record = Record(np.arange(len(u)) * trial.h, u, y, hold=trial.hold)
    problem = prepared([record], model, check_data([record]))[0]
    monkeypatch.setattr(refit, "STEPS", 2)
    monkeypatch.setattr(refit, "regression_start", lambda *_: None)
    monkeypatch.setattr(refit, "NEAR", 0.0)
    early = linear_fit(problem).rho
    monkeypatch.setattr(refit, "NEAR", np.inf)
    assert linear_fit(problem).rho < 1.1 < 1.3 < early


def test_polishing_finds_the_shape_between_the_grid(draw):
    problem, _, screened, truth = problem_and_screen(draw, 12, size="one", kind="single", name="dead_zone")
    wanted = truth[0]["values"]
    first = next(c for c in screened.candidates if c.effect.name == "dead_zone")
    polished = polished_candidate(problem, screened, first)
    assert polished.explained >= first.explained
    assert polished.effect.gap == pytest.approx(wanted["gap"], rel=0.05)
    assert polished.effect.stiffness == pytest.approx(wanted["stiffness"], rel=0.05)


def test_held_near_the_motion_a_fit_reaches_the_friction_that_a_free_run_misses(draw):
    problem, linear, screened, truth = problem_and_screen(draw, 1042, kind="single")
    first = next(c for c in screened.candidates if c.effect.name == "stribeck_friction")
    start = Point(np.zeros(len(problem.entries)), (first.effect,), problem.begins)
    held = leads(problem, screened.seens)
    near = fit(held[0], start, free_parameters(start.effects), 8)
    assert near.rho < 1.2
    led = refine(Arena(problem, linear, held), first, screened.promise(first.explained))
    assert led.fit.rho < 1.2
    assert led.effect.static_force == pytest.approx(truth[0]["values"]["static_force"], rel=0.15)


def test_the_held_problem_is_the_problem_where_nothing_is_missing(draw):
    problem, linear, screened, _ = problem_and_screen(draw, 21, size="one", kind="none")
    for held in leads(problem, screened.seens):
        rows, _ = evaluate(held, linear.point)
        assert rows @ rows / len(rows) < 1.2


def test_two_forces_at_once_are_a_pair(draw):
    problem, _, screened, _ = problem_and_screen(draw, 1403, kind="double")
    best = pairs(problem, screened, 1)[0]
    assert {e.name for e in best.effects} == {"constant_force", "dead_zone"}


@pytest.mark.parametrize("sticks", [True, False])
def test_a_machine_that_stands_still_is_no_stuck_sensor(sticks):
    t = np.arange(4000) * 0.01
    speed = np.sin(0.5 * t) * (1 - np.exp(-((t - 20) ** 4)))  # comes to rest at 20 s
    y = np.cumsum(speed) * 0.01
    y[1990:2011] = y[1990]
    if sticks:
        y[1000:1060] = y[1000]
    faults = check_data([Record(t, np.zeros((4000, 1)), y[:, None])]).faults
    assert [f.evidence["first_sample"] for f in faults if f.name == "stuck_sensor"] == (
        [1000] if sticks else []
    )


def test_whitened_noise_has_unit_variance_at_zero_frequency_too():
    rng = np.random.default_rng(3)
    model = Model([[1.0]], [[0.3]], [[1.0]])
    means = []
    for _ in range(300):
        noise = rng.normal(size=(400, 1))
        trace = trace_of(Record(np.arange(400) * 0.1, np.zeros((400, 1)), noise), model)
        trace = banded(trace, Floor(np.ones(1), np.zeros(1)), 5.0)
        means.append(trace.rows(trace.spectrum(noise))[0])
    assert np.var(means) == pytest.approx(1.0, rel=0.25)


def test_a_drive_that_passes_nothing_takes_no_pairs_place(draw):
    """Two strong springs: a saturation that takes the input away explains more of the linear gap than either."""
    problem, _, screened, truth = problem_and_screen(draw, 3129, size="one", kind="double")
    screened = polished_screen(problem, screened)
    assert all(drives(problem, (c.effect,)) for c in screened.candidates)
    assert not drives(problem, (effect_class("saturation")(0, limit=0.1),))
    best = pairs(problem, screened, 1)[0]
    assert {e.name for e in best.effects} == {x["name"] for x in truth}


def test_a_coupling_is_tried_in_place_of_a_stop_and_kept_where_the_gap_gains_no_more_than_chance(draw):
    problem, linear, _, truth = problem_and_screen(
        draw, 30, size="three", kind="single", name="missing_coupling"
    )
    place = tuple(truth[0]["dof"])
    stop = effect_class("end_stop")(place, stiffness=0.8, gap=1e-3, damping=0.05)
    start = Point(linear.point.theta, (*linear.point.effects, stop), linear.point.starts)
    touching = fit(problem, start, free_parameters(start.effects), 8)
    as_it_is = Candidate(touching.point.effects[-1], 0.0, 0.0, np.zeros(0), touching.point.theta, False)
    rich = Contender(touching, as_it_is, 0.0)
    (plain,) = kindred(Arena(problem, linear), rich, set())
    assert (plain.effect.name, plain.effect.dof) == ("missing_coupling", place)
    assert plain.fit.rho == pytest.approx(rich.fit.rho, rel=0.05)
    chance = 2 * GAP_GAINS * rich.fit.rho
    kept = [cheapest([rich, replace(plain, cost=share * chance)], 1.0, 0.03) for share in (0.9, 1.1)]
    assert [x.effect.name for x in kept] == ["missing_coupling", "end_stop"]


@pytest.mark.parametrize(("share", "named"), [(0.9, "input_delay"), (1.1, "rate_limit")])
def test_a_delay_that_is_alike_is_named_before_a_rate_limit(draw, share, named):
    """Two levels of input make every ramp as long: a delay is the same data, and needs no nonlinearity."""
    _, linear, _, _ = problem_and_screen(draw, 12, size="one", kind="single", name="input_delay")

    def contender(name: str, cost: float) -> Contender:
        one = effect_class(name)(0)
        fitted = replace(linear, point=replace(linear.point, effects=(one,)))
        return Contender(fitted, Candidate(one, 0.0, 0.0, np.zeros(0), linear.point.theta, False), cost)

    kept = cheapest([contender("rate_limit", 0.0), contender("input_delay", share * TIE)], 1.0, 0.03)
    assert kept is not None and kept.effect.name == named


def test_a_budget_keeps_a_share_for_later():
    budget = Budget(10.0)
    budget.keep(0.4)
    budget.left -= 7.0
    assert budget.spent
    budget.keep(0.0)
    assert not budget.spent and not Budget().spent


def test_a_name_too_many_is_dropped_whatever_the_budget(draw):
    problem, _, _, truth = problem_and_screen(draw, 12, size="one", kind="single", name="cubic_stiffness")
    both = (effect_class("cubic_stiffness")(0, **truth[0]["values"]), effect_class("constant_force")(0, 1e-9))
    now = fit(problem, replace(problem.nominal(), effects=both), free_parameters(both))
    spent = replace(problem, budget=Budget(0.0))
    left = pruned(spent, now, lambda without, now: without.rss - now.rss < 25)
    assert [e.name for e in left.point.effects] == ["cubic_stiffness"]


def test_two_names_too_many_are_both_dropped(draw):
    """After the first is dropped the others are other objects: the fit has moved them."""
    problem, _, _, truth = problem_and_screen(draw, 12, size="one", kind="single", name="cubic_stiffness")
    needless = effect_class("quadratic_drag")(0, 1e-9), effect_class("constant_force")(0, 1e-9)
    cubic = effect_class("cubic_stiffness")(0, 1.02 * truth[0]["values"]["stiffness"])
    three = (needless[0], cubic, needless[1])
    now = fit(problem, replace(problem.nominal(), effects=three), free_parameters(three), 0)
    left = pruned(problem, now, lambda without, now: without.rss - now.rss < 25)
    assert [e.name for e in left.point.effects] == ["cubic_stiffness"]


def test_unnamed_shapes_take_no_names_place(draw):
    """Of five finalists one was a shape, and the right name was the sixth."""
    _, _, screened, _ = problem_and_screen(draw, 12, size="one", kind="single", name="cubic_stiffness")
    shapes = [c for c in screened.candidates if c.decoy][:2]
    names = [c for c in screened.candidates if not c.decoy]
    found = [replace(c, explained=1e4) for c in (*shapes, *names)]
    assert sum(not c.decoy for c in shortlist(replace(screened, candidates=found), 3)) >= 3


def test_a_ripple_longer_than_the_travel_is_a_spring_by_another_name(draw):
    problem, linear, screened, _ = problem_and_screen(
        draw, 12, size="one", kind="single", name="cubic_stiffness"
    )
    travel = float(np.ptp(screened.seens[0].q[:, 0]))
    for pitch, is_none in ((0.5 * travel, False), (2 * travel, True)):
        ripple = effect_class("position_ripple")(0, 0.1, pitch, 0.3)
        found = replace(linear, point=replace(linear.point, effects=(ripple,)))
        assert _no_turn(problem, found) is is_none


@pytest.mark.parametrize(("share", "kept"), [(0.9, "coulomb_friction"), (1.1, "stribeck_friction")])
def test_what_another_rounding_of_a_sign_gains_is_no_stribeck_friction(draw, share, kept):
    problem, _, _, truth = problem_and_screen(
        draw, 12, size="one", kind="single", name="coulomb_friction", strength=(0.6, 0.9)
    )
    plain, later = (
        effect_class("coulomb_friction")(0, **truth[0]["values"]),
        effect_class("constant_force")(0, 1e-9),
    )
    rich = effect_class("stribeck_friction")(0, plain.force, 1.01 * plain.force, 0.1, plain.speed)
    stuck, slid = (fit(problem, replace(problem.nominal(), effects=(x, later))) for x in (rich, plain))

    def others(without, now, effect):
        explained = without.rss - now.rss
        assert explained > 1e4
        behind = share * 2 * RICHER_GAINS * explained
        sliding = replace(slid, point=replace(slid.point, effects=(later, plain)))
        yield Contender(sliding, Candidate(plain, 0.0, 0.0, np.zeros(0), slid.point.theta, False), behind)

    told = reconsidered(problem, stuck, lambda one: 0.0, 0.0, others)
    assert kept in [e.name for e in told.point.effects]


def test_a_dead_band_on_two_levels_is_no_gain_where_the_levels_differ_between_records():
    rng, h, N = np.random.default_rng(3), 0.05, 3000
    A, B, C, _, _ = cont2discrete(
        (np.array([[0, 1], [-25, -0.5]]), np.array([[0], [1.0]]), np.array([[1.0, 0]]), np.zeros((1, 1))), h
    )
    records = []
    for level in (1.0, 0.5, 1.0):
        u = level * np.repeat(rng.choice([-1.0, 1.0], N // 5), 5)
        y = dlsim((A, B, C, np.zeros((1, 1)), h), u - np.clip(u, -0.2, 0.2))[1]
        noise = 0.01 * y.std() * rng.normal(size=y.shape)
        records.append(Record(np.arange(N) * h, u[:, None], y + noise, hold="zoh"))
    model = Model(np.eye(1), 0.5 * np.eye(1), 25 * np.eye(1), hold="zoh")
    answer = find_gap(records[:2], records[2:], model, power=False)
    assert [e.name for e in answer.added] == ["input_dead_band"]
    assert answer.added[0].values[0] == pytest.approx(0.2, rel=0.05)


def test_a_motion_that_no_free_run_follows_is_followed_in_pieces(draw):
    trial = draw(40258, kind="single").trial()
    model = Model(trial.M, trial.D, trial.K, input_map=trial.L, hold=trial.hold)
    u, y = trial.train
    record = Record(np.arange(len(u)) * trial.h, u, y, hold=trial.hold)
    problem = prepared([record], model, check_data([record]))[0]
    law = effect_class("dead_zone")(dof=1, **trial.truth["effects"][0]["values"])
    start = replace(problem.nominal(), effects=(law,))
    rows, runs = evaluate(problem, start)  # of the truth: what is left grows out of rounding
    at_truth = Fit(start, rows, runs, 0.0, ())
    assert at_truth.rho > 100
    parted = in_pieces(problem, at_truth)
    ends = [first + piece.N for piece in parted.traces for _, first in [piece.part_of]]
    assert parted.traces[0].part_of[1] > 0.02 * len(u)  # a smoothed motion says little of how a record begins
    assert max(ends) < 0.98 * len(u)
    near = fit(parted, replace(start, starts=parted.begins), free_parameters((law,)), 3)
    assert near.rho < 1.1
    whole, same = as_wholes(parted, near)
    assert (len(whole.traces), len(same.rows)) == (len(problem.traces), len(rows))
    other = replace(problem.traces[0])
    assert wholes((*parted.traces, other, replace(parted.traces[0], part_of=(other, 9)))) == (
        problem.traces[0],
        other,
        other,
    )
    look = Round(screen(parted, near, [effect_class("dead_zone")]), [], near, None)
    where = where_values(SimpleNamespace(problem=parted, story=Story(near, near, [look])))
    assert len(where["share_by_tenth_of_record"]) == 10  # of the whole record, not of a piece
    assert sum(where["share_by_tenth_of_record"]) == pytest.approx(1)


def test_a_band_of_eight_bins_is_looked_at_like_any_other(draw):
    problem, _, _, _ = problem_and_screen(draw, 21, size="one", kind="none")
    narrow = problem.on(tuple(banded(t, Floor(t.variance, np.zeros(1)), 0.0) for t in problem.traces))
    assert narrow.traces[0].F == 8  # fewer than the bins that are averaged where the motion is smoothed
    assert len(linear_fit(narrow).rows) == 16


def test_names_that_leave_little_have_not_lost_the_motion():
    linear, near, far = (SimpleNamespace(rho=rho) for rho in (4.0, 1.33, 2.5))
    assert not lost("effect", near, linear) and lost("effect", far, linear)
    assert lost("unknown", near, linear) and not lost("unknown", SimpleNamespace(rho=1.2), linear)


def test_an_effect_that_the_rest_cannot_do_without_is_named_again_too(draw, monkeypatch):
    problem, linear, _, _ = problem_and_screen(draw, 21, size="one", kind="none")
    stop, coupling = effect_class("end_stop")(0, 1.0, 1e-5), effect_class("cubic_stiffness")(0, 1e-3)
    monkeypatch.setattr(again, "_without", lambda *_: None)  # as it is where that motion leaves every bound
    told = [replace(linear, point=replace(linear.point, effects=(x, coupling))) for x in (stop, coupling)]

    def others(without, now, effect):
        assert without is None
        yield Contender(told[1], Candidate(coupling, 0.0, 0.0, np.zeros(0), linear.point.theta, False), 0.0)

    assert reconsidered(problem, told[0], lambda one: 0.0, 0.1, others) is told[1]
