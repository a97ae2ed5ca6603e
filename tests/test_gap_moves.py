"""Wrong M, D, K that few sensors tell only together."""

from __future__ import annotations

import numpy as np
import pytest

from sysid_bench.gap.workflow import find_gap
from sysid_bench.mechanics.nonlinear import simulate
from sysid_bench.nouns import Model, Plant, Record

M = np.diag([1.1, 0.83, 0.92])
K = np.array([[2.25, -1.05, 0.0], [-1.05, 2.03, -0.98], [0.0, -0.98, 0.98]])
D = 0.03 * K
MAPS = {"input_map": np.eye(3)[:, :1], "output_map": np.eye(3)[1:2]}
H = 0.16


def recorded(seed: int) -> Record:
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(3000, 1))
    y = simulate(Plant(M, D, K, **MAPS), u, H, "zoh").y
    return Record(np.arange(len(u)) * H, u, y + 0.03 * y.std() * rng.normal(size=y.shape), hold="zoh")


@pytest.mark.parametrize(("off", "verdict"), [(1.2, "parameters"), (1.01, "none")])
def test_one_sensor_tells_that_a_mass_is_wrong_though_no_entry_alone_is_certain(off, verdict):
    given = Model(M * np.diag([off, 1.0, 1.0]), D, K, **MAPS, hold="zoh", initial_state="free")
    found = find_gap([recorded(1)], [recorded(2)], given, power=False)
    assert found.verdict.word == verdict
    if verdict == "parameters":
        assert found.gap_after < 0.1 * found.gap_before
