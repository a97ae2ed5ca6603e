"""A machine of nanograms and microseconds is the same machine: no digit hangs on the units."""

import numpy as np
import pytest

from sysid_bench.build import build
from sysid_bench.conf import groups, option
from sysid_bench.gap.check_data import lattice_step
from sysid_bench.mechanics.exact_step import exact_step
from sysid_bench.mechanics.exponential import balanced, exponential
from sysid_bench.mechanics.simulate import simulate
from sysid_bench.nouns import Model, Plant, Record
from sysid_bench.run import identify

M, D, K = np.eye(2), np.array([[0.2, -0.1], [-0.1, 0.2]]), np.array([[2.0, -1.0], [-1.0, 2.0]])
H, N = 0.3, 600
UNITS = [(1e-9, 1e-6), (1e-26, 1e-13), (1e12, 1e4)]  # of mass in kg, of time in s
METHODS = [name for name in groups()["method"] if not name.startswith(("peer_", "discrete_lagrangian"))]


def matrices(mass: float, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return mass * M, mass * D / time, mass * K / time**2


def forces() -> np.ndarray:
    return np.random.default_rng(0).normal(size=(N, 2))


@pytest.mark.parametrize(("mass", "time"), UNITS)
@pytest.mark.parametrize("hold", ["zoh", "foh", "cubic", "cayley", "gauss2"])
def test_a_motion_is_the_same_in_all_units(hold: str, mass: float, time: float) -> None:
    u, x0 = forces(), np.array([0.3, -0.1, 0.2, 0.5])
    known = simulate(Plant(M, D, K), u, H, hold, x0)
    start = np.concatenate([x0[:2] * time**2 / mass, x0[2:] * time / mass])
    found = simulate(Plant(*matrices(mass, time)), u, H * time, hold, start) * mass / time**2
    assert np.abs(found - known).max() < 1e-12 * np.abs(known).max()


@pytest.mark.parametrize(("mass", "time"), UNITS)
def test_a_small_step_is_the_same_in_all_units(mass: float, time: float) -> None:
    known, found = exact_step(M, D, K, H), exact_step(*matrices(mass, time), H * time)
    q, v = found.middle[:2] * mass / time**2, found.middle[2:] * mass / time
    assert np.allclose(np.vstack([q, v]), known.middle, rtol=1e-12, atol=1e-14)
    units = np.array([1.0, 1.0, 1 / time, 1 / time])
    assert np.allclose(found.Ad / units[:, None] * units, known.Ad, rtol=1e-12, atol=1e-14)


def test_a_motion_too_fast_for_the_step_is_no_number() -> None:
    step = exact_step(np.array([[1e-20]]), np.array([[1e-10]]), np.array([[1e20]]), 0.1)
    assert np.isnan(step.Ad).all() and np.isnan(step.start).all()


def test_balancing_rounds_nothing() -> None:
    A = np.random.default_rng(1).normal(size=(6, 6)) * 10.0 ** np.arange(-9, 9, 3)[:, None]
    B, units = balanced(A)
    assert np.array_equal(units[:, None] * B / units, A)
    assert np.allclose(exponential(np.array([[0.0, 1e-12], [-1e12, 0.0]])), [[np.cos(1), 1e-12 * np.sin(1)], [-1e12 * np.sin(1), np.cos(1)]], rtol=1e-14)  # fmt: skip


@pytest.mark.parametrize("name", METHODS)
def test_an_estimate_is_the_same_in_all_units(name: str) -> None:
    """Six digits: a search stops where it cannot improve."""
    method = build(option("method", name))
    u = forces()
    y = simulate(Plant(M, D, K), u, H, "zoh") + 0.01 * np.random.default_rng(1).normal(size=(N, 2))

    def found(mass: float, time: float) -> list[np.ndarray]:
        model = Model(*matrices(mass, time), hold="zoh")
        record = Record(H * time * np.arange(N), u, y * time**2 / mass, "zoh")
        e = identify(method, record, model if method.nominal else model.structure_only())
        assert e.status == "ok" and e.M is not None and e.D is not None and e.K is not None
        return [e.M / mass, e.D * time / mass, e.K * time**2 / mass]

    known = found(1.0, 1.0)
    for mass, time in UNITS:
        for one, other in zip(found(mass, time), known):
            assert np.linalg.norm(one - other) < 1e-6 * np.linalg.norm(other), (
                f"{name} in {mass} kg and {time} s"
            )


@pytest.mark.parametrize("size", [1e-15, 1.0, 1e15])
def test_the_step_of_a_quantised_sensor_is_found_in_all_units(size: float) -> None:
    y = np.random.default_rng(0).normal(size=2000)
    assert lattice_step([size * np.round(y, 1)]) == pytest.approx(0.1 * size)
    assert lattice_step([size * y]) == 0.0


@pytest.mark.filterwarnings("error")
def test_units_beyond_the_integers_are_balanced_in_silence() -> None:
    A = np.array([[0.0, 1e150], [1e-30, 0.0]])
    B, units = balanced(A)
    assert units.max() / units.min() > 2.0**63
    np.testing.assert_array_equal(units[:, None] * B / units, A)
