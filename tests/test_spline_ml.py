"""In-band maximum likelihood: exact without noise, at the bound with it, whatever is driven, seen or held."""

from dataclasses import replace

import numpy as np
import pytest

from sysid_bench import conf
from sysid_bench.build import build
from sysid_bench.mechanics import information
from sysid_bench.mechanics.estimation import Problem, fit_problem, in_band_run, problem_of
from sysid_bench.mechanics.fisher import crlb
from sysid_bench.mechanics.in_band import thinned
from sysid_bench.mechanics.information import information_and_gradient
from sysid_bench.mechanics.likelihood import Run, evaluate
from sysid_bench.mechanics.maximum import maximise
from sysid_bench.mechanics.refined_iv import refine
from sysid_bench.mechanics.response import modes_of
from sysid_bench.mechanics.second_order import pack, unpack
from sysid_bench.mechanics.simulate import simulate
from sysid_bench.mechanics.start import GROWTH, linear_start, refined_start
from sysid_bench.methods.spline_ml import SplineML
from sysid_bench.nouns import InputError, Model, Plant, Record
from sysid_bench.score import relative_error


def plant_named(name: str, **changes) -> Plant:
    return replace(build(conf.option("plant", name)), **changes)


def knots(per_knot: int, N: int, nu: int, rng: np.random.Generator) -> np.ndarray:
    from scipy.interpolate import CubicSpline

    count = N // per_knot + 4
    return CubicSpline(np.arange(count), rng.standard_normal((count, nu)))(np.arange(N) / per_knot)


def record_of(
    plant: Plant, h: float, N: int = 1200, hold: str = "cubic", snr_db: float | None = None, seed: int = 1,
    per_knot: int = 2, start: float = 0.0,
) -> tuple[Record, np.ndarray]:  # fmt: skip
    rng = np.random.default_rng(seed)
    u = knots(per_knot, N, plant.nu, rng)
    period = N if hold == "bandlimited" else None
    states = simulate(
        replace(plant, output="displacement", output_map=np.eye(plant.n)), u, h, hold, None, period
    )
    x0 = start * np.concatenate([states[N // 2], states[N // 3]])
    y = simulate(plant, u, h, hold, x0, period)
    variance = np.zeros(plant.ny) if snr_db is None else y.var(axis=0) * 10 ** (-snr_db / 10)
    y = y + rng.standard_normal(y.shape) * np.sqrt(variance)
    return Record(h * np.arange(N), u, y, hold, period=N if hold == "bandlimited" else None), variance


def worst_error(estimate, plant: Plant) -> float:
    return max(
        relative_error(got, truth)
        for got, truth in zip(
            (estimate.M, estimate.D, estimate.K), (plant.mass, plant.damping, plant.stiffness), strict=True
        )
    )


@pytest.mark.parametrize(("name", "h"), [("three_dof", 0.5), ("three_dof", 0.05), ("eight_dof", 0.05)])
@pytest.mark.parametrize("hold", ["zoh", "foh", "cubic", "bandlimited"])
def test_a_noise_free_record_gives_the_plant_back(name: str, h: float, hold: str) -> None:
    plant = plant_named(name)
    record, _ = record_of(plant, h, hold=hold, start=0.5)
    assert worst_error(SplineML().fit(record, Model(n=plant.n)), plant) < 1e-10


@pytest.mark.parametrize("output", ["velocity", "acceleration"])
def test_velocities_and_accelerations_will_do(output: str) -> None:
    plant = plant_named("three_dof", output=output)
    record, _ = record_of(plant, 0.25, start=0.5)
    assert worst_error(SplineML().fit(record, plant.model().structure_only()), plant) < 1e-10


def test_fewer_forces_than_masses_will_do_where_the_record_tells() -> None:
    plant = plant_named("three_dof", input_map=np.eye(3)[:, :2])
    record, _ = record_of(plant, 0.25)
    assert worst_error(SplineML().fit(record, plant.model().structure_only()), plant) < 1e-9


def test_known_entries_stay_and_help() -> None:
    plant = plant_named("three_dof")
    record, _ = record_of(plant, 0.1, snr_db=15)
    mask = np.eye(3, dtype=bool)
    estimate = SplineML().fit(record, replace(plant.model(), free={"mass": mask}))
    assert np.array_equal(estimate.M[~mask], plant.mass[~mask])
    assert np.all(estimate.std("M")[~mask] == 0) and np.all(estimate.std("M")[mask] > 0)
    assert estimate.std("K").sum() < SplineML().fit(record, Model(n=3)).std("K").sum()


@pytest.mark.parametrize("hold", ["zoh", "foh", "cubic"])
def test_the_likelihood_finds_the_hold(hold: str) -> None:
    plant = plant_named("three_dof")
    record, _ = record_of(plant, 0.5, N=3000, hold=hold, snr_db=25)
    estimate = SplineML(hold="auto").fit(record, Model(n=3))
    assert estimate.diagnostics["hold"] == hold and estimate.diagnostics["hold_margin"] > 3


def test_several_records_weigh_together() -> None:
    plant = plant_named("three_dof")
    first, _ = record_of(plant, 0.25, snr_db=15, seed=1)
    second, _ = record_of(plant, 0.1, snr_db=10, seed=2, per_knot=6)
    both = SplineML().fit([first, second], Model(n=3))
    for record in (first, second):
        assert both.std("D").sum() < SplineML().fit(record, Model(n=3)).std("D").sum()
    assert worst_error(both, plant) < 0.1


def test_its_covariance_is_the_cramer_rao_bound() -> None:
    plant = plant_named("three_dof")
    record, variance = record_of(plant, 0.25, N=6000, snr_db=20, per_knot=4)
    estimate, bound = SplineML().fit(record, Model(n=3)), crlb(plant, record, variance)
    ratio = np.sqrt(np.diag(estimate.covariance) / np.diag(bound.covariance))
    assert np.all(np.abs(ratio - 1) < 0.1)


def test_what_it_cannot_use_is_refused_with_the_way_out() -> None:
    plant = plant_named("three_dof")
    record, _ = record_of(plant, 0.25, N=200)
    with pytest.raises(InputError, match="input_map"):
        SplineML().fit(record, Model(n=2))
    with pytest.raises(InputError, match="hold must be"):
        SplineML(hold="spline")


@pytest.mark.parametrize(("L", "C"), [(8, 5), (6, 8), (6, 6)])
def test_fewer_sensors_or_forces_than_masses_will_do_where_the_record_tells(L: int, C: int) -> None:
    plant = plant_named("eight_dof", input_map=np.eye(8)[:, :L], output_map=np.eye(8)[8 - C :])
    record, _ = record_of(plant, 0.05, N=3000)
    estimate = SplineML().fit(record, plant.model().structure_only())
    assert worst_error(estimate, plant) < 1e-6
    assert estimate.diagnostics["information_rank"] == 108 and not estimate.diagnostics["cannot_be_told"]


def test_missing_samples_cost_no_more_than_they_held() -> None:
    plant = plant_named("three_dof")
    record, _ = record_of(plant, 0.25, N=1500, per_knot=4)
    rng = np.random.default_rng(5)
    lost = rng.random(1500) < 0.05
    y = np.where(lost[:, None], np.nan, record.y)
    flagged = replace(record, y=y, quality=lost.astype(np.uint8))
    estimate = SplineML().fit(flagged, Model(n=3))
    assert worst_error(estimate, plant) < 1e-5 and "missing" in estimate.diagnostics["warning"]
    holes = replace(record, t=record.t[~lost], u=record.u[~lost], y=record.y[~lost])
    assert worst_error(SplineML().fit(holes, Model(n=3)), plant) < 0.05


def test_definite_matrices_stay_definite() -> None:
    plant = plant_named("three_dof", damping=np.diag([0.1, 0.0, 0.0]))
    record, _ = record_of(plant, 0.25, N=1500, snr_db=5, per_knot=4)
    free = SplineML().fit(record, Model(n=3))
    assert np.linalg.eigvalsh(free.D)[0] < 0
    definite = SplineML(definite=True).fit(record, Model(n=3))
    assert np.linalg.eigvalsh(definite.D)[0] >= -1e-9 and np.linalg.eigvalsh(definite.M)[0] > 0
    assert relative_error(definite.D, plant.damping) < relative_error(free.D, plant.damping)


def test_a_signal_under_the_noise_leads_to_the_maximum_that_the_truth_leads_to() -> None:
    """Eight masses at -10 dB: least squares starts far off, among indefinite matrices."""
    plant = plant_named("eight_dof")
    record, _ = record_of(plant, 0.0125, N=6000, snr_db=-10, per_knot=8, seed=6)
    with np.errstate(all="ignore"):
        found = fit_problem(problem_of([record], Model(n=8), "diagonal", False, False), "cubic")
        best = maximise(found.runs, pack(plant.mass, plant.damping, plant.stiffness))
    assert best.converged and found.cost < best.cost + 0.01


def test_proportional_damping_is_kept_and_its_interval_is_right() -> None:
    plant = plant_named("three_dof")  # D = K / 10
    exact, _ = record_of(plant, 0.25, N=1500, per_knot=4)
    assert worst_error(SplineML(damping="proportional").fit(exact, Model(n=3)), plant) < 1e-10
    rng, free, kept = np.random.default_rng(2), [], []
    for _ in range(60):
        noisy = replace(exact, y=exact.y + 0.2 * exact.y.std(axis=0) * rng.standard_normal(exact.y.shape))
        free.append(relative_error(SplineML().fit(noisy, Model(n=3)).D, plant.damping))
        estimate = SplineML(damping="proportional").fit(noisy, Model(n=3))
        kept.append(((estimate.D - plant.damping) / estimate.std("D"))[np.triu_indices(3)])
        factors = np.linalg.lstsq(np.stack([estimate.M.ravel(), estimate.K.ravel()], 1), estimate.D.ravel())
        assert np.linalg.norm(factors[1]) < 1e-20
    assert relative_error(estimate.D, plant.damping) < np.median(free)
    assert 0.8 < np.sqrt(np.mean(np.square(kept))) < 1.2


@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_undamped_and_repeated_modes_are_no_case_of_their_own(damping: float) -> None:
    """Two of three modes coincide exactly; each entry within its interval, none of the frequencies told apart."""
    M, turn = np.diag([1.0, 2.0, 1.5]), np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    root = np.sqrt(M)
    plant = Plant(M, damping * M, root @ turn @ np.diag([4.0, 4.0, 9.0]) @ turn.T @ root)
    record, _ = record_of(plant, 0.2, N=1500, per_knot=4)
    assert worst_error(SplineML().fit(record, Model(n=3)), plant) < 1e-8
    noisy, variance = record_of(plant, 0.2, N=1500, per_knot=4, snr_db=15)
    estimate, bound = SplineML().fit(noisy, Model(n=3)), crlb(plant, noisy, variance)
    pairs = (("M", plant.mass), ("D", plant.damping), ("K", plant.stiffness))
    assert all(relative_error(getattr(estimate, x), X) < 3 * getattr(bound, x) for x, X in pairs)


def test_what_cannot_be_told_is_named() -> None:
    """The third mass hangs by itself and swings freely: only its frequency and damping show."""
    plant = Plant(
        np.diag([1.0, 2.0, 3.0]), np.diag([0.2, 0.3, 0.05]), np.diag([1.0, 3.0, 9.0]), np.eye(3)[:, :2]
    )
    rng = np.random.default_rng(1)
    u = knots(4, 600, 2, rng)
    y = simulate(plant, u, 0.25, "cubic", np.array([0, 0, 1.0, 0, 0, 0]))
    record = Record(0.25 * np.arange(600), u, y + 0.01 * rng.standard_normal(y.shape), "cubic")
    estimate = SplineML(nominal=True).fit(record, plant.model())
    assert "M[2,2]" in estimate.diagnostics["cannot_be_told"] and estimate.std("M")[2, 2] > 0.5


@pytest.mark.slow
@pytest.mark.parametrize(("name", "h", "snr_db"), [("three_dof", 0.1, 15.0), ("eight_dof", 0.0125, 8.0)])
def test_it_is_at_the_bound(name: str, h: float, snr_db: float) -> None:
    plant, ratios = plant_named(name), []
    for seed in range(60):
        record, variance = record_of(
            plant, h, 6000, "cubic", snr_db, seed, per_knot=10 if name == "three_dof" else 8
        )
        estimate, bound = SplineML().fit(record, Model(n=plant.n)), crlb(plant, record, variance)
        pairs = (("M", plant.mass), ("D", plant.damping), ("K", plant.stiffness))
        ratios.append([relative_error(getattr(estimate, x), truth) / getattr(bound, x) for x, truth in pairs])
    assert np.all(np.sqrt(np.mean(np.square(ratios), axis=0)) < 1.2)


def dim_run() -> tuple[Run, Problem]:
    """Eight masses at 8 dB, every so many-th bin of the band: few for 108 unknowns."""
    plant = plant_named("eight_dof")
    record, _ = record_of(plant, 0.1, N=3000, snr_db=8, per_knot=1, seed=1)
    problem = problem_of([record], plant.model().structure_only(), "diagonal", False, False)
    run = in_band_run(record, problem, "cubic")
    data, F = thinned(run.data, run.F, 250)
    return replace(run, data=data, F=F), problem


def growth(theta: np.ndarray) -> float:
    found = modes_of(*unpack(theta, 8)).poles
    return float((found.real / np.abs(found)).max())


def test_an_instrumental_step_that_runs_away_is_not_taken() -> None:
    run, problem = dim_run()
    start = linear_start([run], problem.free, problem.known)
    assert growth(start) < 0 < GROWTH < growth(refine(run.equation, start, steps=3)[0])
    assert growth(refined_start([run], problem.free, start).theta) <= GROWTH


@pytest.mark.parametrize("noise", ["diagonal", "full", "coloured"])
def test_sums_over_blocks_of_bins_are_the_sum_over_all(noise: str, monkeypatch) -> None:
    plant = plant_named("three_dof")
    record, _ = record_of(plant, 0.1, snr_db=15)
    problem = problem_of([record], plant.model().structure_only(), noise, False, False)
    run = in_band_run(record, problem, "cubic")
    if noise == "coloured":
        run = replace(run, weight=np.linspace(1.0, 2.0, 3 * run.F).reshape(run.F, 3))
    point = evaluate(pack(plant.mass, plant.damping, plant.stiffness), [run])
    whole = information_and_gradient(point, [run])
    monkeypatch.setattr(information, "BLOCK", 9 * (run.F // 3))
    monkeypatch.setattr(information, "FEWEST", 1)
    for got, wanted in zip(information_and_gradient(point, [run]), whole, strict=True):
        assert np.allclose(got, wanted, rtol=1e-9, atol=1e-11 * np.abs(wanted).max())
