"""The number of masses is read off the record, also where the weakest mode is not much above the noise."""

from __future__ import annotations

import numpy as np
import pytest
from identification import ONE_DOF, THREE_DOF, simulated, smooth

from sysid_bench.mechanics.order_selection import number_of_dofs
from sysid_bench.nouns import Diverged, Record


@pytest.mark.parametrize(
    ("plant", "snr_db"), [(ONE_DOF, 15), (ONE_DOF, 60), (THREE_DOF, 3), (THREE_DOF, 15), (THREE_DOF, 60)]
)
def test_it_finds_the_number_of_masses(plant, snr_db):
    rng = np.random.default_rng(4)
    record = simulated(plant, smooth(6000, 0.1, 1.0, len(plant[0]), rng), 0.1, "cubic", snr_db, rng)
    assert number_of_dofs(record, len(plant[0]) + 3).n == len(plant[0])


def test_two_sensors_see_all_three():
    rng = np.random.default_rng(4)
    u = smooth(6000, 0.1, 1.0, 3, rng)
    record = simulated(THREE_DOF, u, 0.1, "cubic", 30, rng, C=np.eye(3)[:2])
    assert number_of_dofs(record, 6).n == 3


def test_noise_alone_has_no_order():
    rng = np.random.default_rng(5)
    record = Record(
        0.1 * np.arange(6000), rng.standard_normal((6000, 3)), rng.standard_normal((6000, 3)), "zoh"
    )
    with pytest.raises(Diverged, match="too much noise"):
        number_of_dofs(record, 6)
