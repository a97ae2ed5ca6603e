"""Errors against the sampling time, paired runs of the methods of Bruschetta (2011): three masses 15 dB, eight 20 dB."""

import identification as ident
import numpy as np
import pytest

from sysid_bench import conf
from sysid_bench.build import build
from sysid_bench.mechanics.fisher import crlb
from sysid_bench.methods.n4sid import N4sid
from sysid_bench.methods.variational_pem import VariationalPem
from sysid_bench.nouns import Diverged, Model

SUBSPACE = N4sid(horizon=20, blocks=0)
EXACT = VariationalPem(start="nominal")


def smooth_run(plant, h, Ta, snr_db, seed):
    rng = np.random.default_rng(seed)
    return ident.simulated(plant, ident.smooth(6000, h, Ta, len(plant[0]), rng), h, "cubic", snr_db, rng)


def paired_errors(plant, h, Ta, snr_db, runs, *methods):
    """(methods, runs, 3) relative errors of M, D, K on the same records."""
    found = []
    for seed in range(runs):
        record = smooth_run(plant, h, Ta, snr_db, seed)
        models = [Model(*plant) if method.nominal else Model(n=len(plant[0])) for method in methods]
        found.append([ident.errors(m.fit(record, model), plant) for m, model in zip(methods, models)])
    return np.array(found).swapaxes(0, 1)


def eight_dof():
    plant = build(conf.option("plant", "eight_dof"))
    return plant.mass, plant.damping, plant.stiffness


@pytest.mark.slow
@pytest.mark.parametrize(("h", "factor"), [(0.01, 20), (0.02, 5)])
def test_a_horizon_of_20_blocks_fails_at_small_sampling_times(h, factor):
    old, new = np.median(paired_errors(ident.THREE_DOF, h, 1.0, 15, 20, SUBSPACE, EXACT), axis=1)
    assert old[0] >= factor * new[0]


@pytest.mark.slow
def test_the_variational_method_is_on_the_bound_at_002_and_far_above_it_at_025():
    ratios = {}
    for h in (0.25, 0.02):
        squares = []
        for seed in range(30):
            record = smooth_run(ident.THREE_DOF, h, 1.0, 15, seed)
            model = Model(*ident.THREE_DOF)
            noise = record.y.var(axis=0) / (1 + 10**1.5)
            bound = crlb(model, record, noise)
            error = ident.errors(EXACT.fit(record, model), ident.THREE_DOF)
            squares.append((error / [bound.M, bound.D, bound.K]) ** 2)
        ratios[h] = np.sqrt(np.mean(squares, axis=0))
    assert ratios[0.25][0] >= 5
    assert np.all(ratios[0.02] <= 1.25)


@pytest.mark.slow
def test_the_old_method_wins_the_mass_at_large_sampling_times():
    methods = N4sid(blocks=0), EXACT
    old, new = np.median(paired_errors(eight_dof(), 0.05, 0.1, 20, 10, *methods), axis=1)
    assert old[0] <= 0.75 * new[0]
    assert new[1] < old[1]


@pytest.mark.slow
def test_the_n4sid_start_sets_the_lower_limit_of_the_sampling_time():
    ended = {}
    for h in (0.02, 0.005):
        outcomes = []
        for seed in range(10):
            try:
                VariationalPem().fit(smooth_run(ident.THREE_DOF, h, 1.0, 15, seed), Model(n=3))
                outcomes.append(True)
            except Diverged:
                outcomes.append(False)
        ended[h] = np.mean(outcomes)
    assert ended[0.02] == 1.0 and ended[0.005] <= 0.6


@pytest.mark.parametrize(("method", "expected"), [("direct", (2.6, 4.1, 3.4)), ("modal", (2.8, 71, 1.4))])
def test_medians_of_the_old_method_at_0125(method, expected):
    """Three masses, 15 dB, h = 0.125 s: the prototype's medians of 60 runs, in percent."""
    one = N4sid(projection=method, blocks=0)
    median = 100 * np.median(paired_errors(ident.THREE_DOF, 0.125, 1.0, 15, 12, one)[0], axis=0)
    assert median == pytest.approx(expected, rel=0.35)
