"""Which pairs are tried before any single suspect is led."""

from __future__ import annotations

import numpy as np
import pytest

from sysid_bench.effects import effect_class
from sysid_bench.gap.both import promising
from sysid_bench.gap.candidates import Candidate, Screen
from sysid_bench.gap.pairs import Pair
from sysid_bench.gap.polish import Polished

ROWS, LEFT = 1000, 50_000.0
DRAG = effect_class("quadratic_drag")(0, 1.0)


def screen_whose_best_leaves(rho: float) -> Screen:
    best = Candidate(DRAG, LEFT - rho * ROWS, 0.0, np.zeros(0), np.zeros(3), False)
    return Screen([best], LEFT, {}, ROWS, [])


def pair_that_leaves(rho: float) -> Pair:
    return Pair((DRAG, DRAG), Polished((DRAG, DRAG), LEFT - rho * ROWS, np.zeros(3)), 0.0)


@pytest.mark.parametrize(
    ("alone", "together", "first"), [(21.0, 1.5, True), (21.0, 11.0, False), (1.3, 1.0, False)]
)
def test_pairs_come_first_only_where_they_leave_far_less_than_any_single(alone, together, first):
    found = [pair_that_leaves(together)]
    assert promising(screen_whose_best_leaves(alone), lambda: found) == (found if first else [])


def test_no_pair_is_worked_out_where_a_single_suspect_leaves_the_noise():
    def asked():
        raise AssertionError("pairs cost as much as a screen")

    assert promising(screen_whose_best_leaves(1.2), asked) == []
