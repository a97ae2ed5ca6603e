"""What the information matrix says of rank and of entries that cannot be told."""

import numpy as np

from sysid_bench.mechanics.identifiability import directions, drowned, entry_names, identifiability


def test_a_blind_direction_is_found_whatever_the_units() -> None:
    rng = np.random.default_rng(0)
    J = rng.standard_normal((40, 3)) * [1e-6, 1.0, 1e6]
    J[:, 2] = 1e12 * J[:, 0]
    told = identifiability(directions(J.T @ J), entry_names(1))
    assert told.rank == 2 and told.untold == ("M[0,0]", "K[0,0]")


def test_full_rank_names_nothing() -> None:
    told = identifiability(directions(np.diag([1.0, 4.0, 9.0])), entry_names(1))
    assert told.rank == told.count == 3 and told.untold == () and np.isclose(told.condition, 1)


def test_wide_intervals_are_named_but_not_small_damping() -> None:
    theta = np.array([1.0, 0.01, 5.0])
    assert drowned(np.diag([0.01, 1.0, 16.0]), theta, 1) == ("K[0,0]",)
    assert entry_names(2)[:3] == ["M[0,0]", "M[0,1]", "M[1,1]"]
