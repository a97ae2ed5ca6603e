"""Unnamed shapes beside the names: what only one of them fits is `unknown`; what none fits may be the sum of two names."""

import sys
from pathlib import Path

import numpy as np
import pytest

from sysid_bench.gap.workflow import find_gap
from sysid_bench.nouns import Model, Record

TRIALS = Path(__file__).parents[1] / "experiments" / "hidden_effects"
h, N, FINE = 0.03, 4000, 10
M, D, K = 1.3, 0.8, 205.0
PULL, REACH = 150.0, 0.007


def _attracted(seed: int) -> Record:
    """A mass between magnets whose pull fades away from them; leapfrog by steps of h / 10."""
    rng = np.random.default_rng(seed)
    u = np.convolve(rng.normal(size=N + 20), np.ones(3) / np.sqrt(3), "same")[:N]
    x, v, step, y = 0.0, 0.0, h / FINE, np.empty(N)
    for k in range(N):
        y[k] = x
        for _ in range(FINE):
            x += 0.5 * step * v
            force = u[k] - K * x + PULL * x * np.exp(-((x / REACH) ** 2))
            v = (v * (1 - 0.5 * step * D / M) + step * force / M) / (1 + 0.5 * step * D / M)
            x += 0.5 * step * v
    y += 0.02 * y.std() * rng.normal(size=N)
    return Record(np.arange(N) * h, u[:, None], y[:, None], hold="zoh")


def test_the_pull_of_a_magnet_has_no_name():
    model = Model(M * np.eye(1), D * np.eye(1), K * np.eye(1), hold="zoh")
    answer = find_gap([_attracted(1)], [_attracted(2)], model, power=False)
    assert answer.verdict.word == "unknown"
    assert "a spring that acts near the middle only" in answer.verdict.reason


@pytest.fixture(scope="module")
def draw():
    sys.path.insert(0, str(TRIALS))
    import draw

    yield draw.Draw
    sys.path.remove(str(TRIALS))


def test_a_shape_that_does_not_close_the_gap_may_stand_for_two_names(draw):
    trial = draw(60158, kind="double").trial()
    model = Model(trial.M, trial.D, trial.K, input_map=trial.L, hold=trial.hold)
    train, test = (
        Record(np.arange(len(u)) * trial.h, u, y, hold=trial.hold) for u, y in (trial.train, trial.test)
    )
    answer = find_gap([train], [test], model, power=False)
    assert answer.story.rounds[0].contenders[0].is_decoy  # alone, a shape without a name fits best
    assert sorted(e.name for e in answer.added) == ["end_stop", "quadratic_stiffness"]
