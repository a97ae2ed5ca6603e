"""The check before a fit: good records pass, each defect is named, the hopeless are refused."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from sysid_bench.mechanics.excitation_check import check_excitation
from sysid_bench.mechanics.simulate import simulate
from sysid_bench.nouns import NotApplicable, Plant, Record

PLANT = Plant(np.diag([1.0, 1.5]), np.array([[0.3, -0.1], [-0.1, 0.3]]), np.array([[4.0, -1.0], [-1.0, 6.0]]))


def record(
    h: float = 0.1, N: int = 4000, knot_s: float = 0.8, u=None, step: float = 0.0, noise: float = 0.01
) -> Record:
    rng = np.random.default_rng(0)
    t = h * np.arange(N)
    if u is None:
        count = int(t[-1] / knot_s) + 4
        u = CubicSpline(knot_s * np.arange(count), rng.standard_normal((count, 2)))(t)
    y = simulate(PLANT, u, h, "cubic")
    y = y + noise * y.std() * rng.standard_normal(y.shape)
    return Record(t, u, np.round(y / step) * step if step else y, "cubic")


def test_a_good_record_passes_without_remarks() -> None:
    assert check_excitation(record()) == []


def test_each_defect_is_named() -> None:
    slow = record(knot_s=8.0)
    assert any("next to nothing" in x for x in check_excitation(slow))
    assert any("Nyquist" in x for x in check_excitation(record(h=2.0, knot_s=2.0, N=1000)))
    assert any("periods" in x for x in check_excitation(record(N=120)))
    assert any("levels" in x for x in check_excitation(record(step=0.2)))
    both = record().u.copy()
    both[:, 1] = both[:, 0] + 1e-3 * both[:, 1]
    assert any("nearly multiples" in x for x in check_excitation(record(u=both)))


def test_the_hopeless_are_refused_with_the_way_out() -> None:
    good = record()
    still = good.u.copy()
    still[:, 1] = 1.0
    for u, why in (
        (0 * good.u, "no force"),
        (still, "input 2 is constant"),
        (good.u[:, [0, 0]], "multiples"),
    ):
        with pytest.raises(NotApplicable, match=why):
            check_excitation(Record(good.t, u, good.y, "cubic"))


def test_what_leaks_from_the_ends_of_a_short_fast_record_is_no_response() -> None:
    assert not any("next to nothing" in x for x in check_excitation(record(h=0.002, N=10000, noise=0.001)))
