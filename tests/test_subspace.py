"""n4sid and what it is made of."""

import identification as ident
import numpy as np
import pytest

from sysid_bench.mechanics import hankel as hk
from sysid_bench.mechanics import subspace
from sysid_bench.mechanics.second_order import pack
from sysid_bench.methods.n4sid import N4sid
from sysid_bench.nouns import Model, NotApplicable


def test_the_gram_matrix_is_that_of_the_hankel_matrix():
    z = np.random.default_rng(0).standard_normal((200, 3))
    H = hk.hankel(z, 8)
    assert H.shape == (24, 193) and np.array_equal(H[3:6, 5], z[6])
    assert np.allclose(hk.hankel_gram(z, 8), H @ H.T, rtol=1e-11, atol=1e-10)


def test_noise_free_outputs_fall_back_on_the_qr_of_the_data():
    u = ident.binary(600, 1, 0)
    clean = np.hstack([u, ident.simulated(ident.ONE_DOF, u, 0.5, "zoh").y])
    order = hk.order_rows(1, 1, 8)
    assert hk.safe_cholesky(hk.hankel_gram(clean, 16)[np.ix_(order, order)]) is None
    R, H = hk.triangular_factor(clean, order, 16), hk.hankel(clean, 16)[order]
    assert np.allclose(R @ R.T, H @ H.T, atol=1e-9)
    noisy = clean + 0.05 * np.random.default_rng(0).standard_normal(clean.shape)
    R, H = hk.triangular_factor(noisy, order, 16), hk.hankel(noisy, 16)[order]
    assert np.allclose(R @ R.T, H @ H.T, atol=1e-9)


@pytest.mark.parametrize("weight", ["moesp", "cva"])
@pytest.mark.parametrize("projection", ["direct", "modal"])
def test_noise_free_zoh_data_give_the_plant_back(weight, projection):
    record = ident.simulated(ident.UNEVEN, ident.binary(900, 3, 1), 0.5, "zoh", x0=np.ones(6))
    estimate = N4sid(weight=weight, projection=projection).fit(record, Model(n=3))
    assert ident.errors(estimate, ident.UNEVEN).max() < 1e-7


@pytest.mark.parametrize("output", ["velocity", "acceleration"])
def test_other_outputs(output):
    record = ident.simulated(ident.UNEVEN, ident.binary(900, 3, 1), 0.5, "zoh", output=output)
    estimate = N4sid().fit(record, Model(n=3, output=output))
    assert ident.errors(estimate, ident.UNEVEN).max() < 1e-6


def test_the_records_hold_removes_the_bias_of_the_zoh_on_a_smooth_input():
    rng = np.random.default_rng(0)
    record = ident.simulated(ident.THREE_DOF, ident.smooth(3000, 0.25, 1.0, 3, rng), 0.25, "cubic", 40, rng)
    thesis = ident.errors(N4sid(blocks=0).fit(record, Model(n=3)), ident.THREE_DOF)
    right = ident.errors(N4sid(blocks=0, hold="record").fit(record, Model(n=3)), ident.THREE_DOF)
    assert np.all(right < 0.5 * thesis)


def test_the_state_space_reproduces_the_output():
    record = ident.simulated(ident.UNEVEN, ident.binary(900, 3, 1), 0.5, "zoh")
    A, B, C, D, h = N4sid(blocks=0).fit(record, Model(n=3)).state_space
    x, y = np.zeros(6), np.zeros((900, 3))
    for k in range(900):
        y[k] = C @ x + D @ record.u[k]
        x = A @ x + B @ record.u[k]
    assert h == 0.5 and np.allclose(y, record.y, atol=1e-7)


def test_the_order_is_found_by_the_gap():
    rng = np.random.default_rng(3)
    record = ident.simulated(ident.THREE_DOF, ident.binary(3000, 3, 2), 0.5, "zoh", 30, rng)
    estimate = N4sid(order="gap").fit(record, Model(n=3))
    assert estimate.diagnostics["order"] == 6
    assert ident.errors(estimate, ident.THREE_DOF).max() < 0.05
    other = N4sid(order=4).fit(record, Model(n=3))
    assert other.M is None and len(other.poles) == 4 and "order" in other.reason


def test_the_horizon_in_seconds_takes_precedence():
    rng = np.random.default_rng(3)
    record = ident.simulated(ident.THREE_DOF, ident.binary(1000, 3, 2), 0.1, "zoh", 30, rng)
    assert N4sid(horizon=8, blocks=0).fit(record, Model(n=3)).diagnostics["horizon"] == 8
    assert N4sid(horizon=8, horizon_s=1.2, blocks=0).fit(record, Model(n=3)).diagnostics["horizon"] == 12


def test_unstable_poles_are_mirrored():
    A = np.array([[1.1, 0.3], [-0.3, 1.1]])
    modes = subspace.half_modes(A, np.eye(2))
    assert modes.reflected == 2 and np.abs(modes.p[0]) == pytest.approx(1 / abs(1.1 + 0.3j))


def test_short_records_and_constant_inputs_are_declined():
    record = ident.simulated(ident.THREE_DOF, ident.binary(60, 3, 2), 0.1, "zoh")
    with pytest.raises(NotApplicable, match="too few"):
        N4sid(horizon=20).fit(record, Model(n=3))
    still = ident.simulated(ident.ONE_DOF, np.ones((400, 1)), 0.1, "zoh")
    with pytest.raises(NotApplicable, match="constant"):
        N4sid().fit(still, Model(n=1))


@pytest.mark.parametrize(("seed", "limit"), [(0, 0.0025), (1, 0.0025), (2, 0.005)])
def test_poles_are_as_good_as_slicots(seed, limit):
    """SLICOT's n4sid has 0.0013, 0.0016, 0.0033 on records of this kind (i = 10, 15 dB, Ta = 0.2 s)."""
    rng = np.random.default_rng(seed)
    u = ident.smooth(6000, 0.1, 0.2, 3, rng)
    record = ident.simulated(ident.THREE_DOF, u, 0.1, "cubic", 15, rng)
    estimate = N4sid(horizon=10, blocks=0).fit(record, Model(n=3))
    assert ident.pole_error(estimate, ident.THREE_DOF) < limit


def test_standard_errors_cover_the_truth():
    runs = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        record = ident.simulated(ident.THREE_DOF, ident.binary(2500, 3, seed), 0.25, "zoh", 20, rng)
        runs.append(N4sid().fit(record, Model(n=3)))
    assert 0.90 <= ident.covered(runs, ident.THREE_DOF, pack).mean() <= 0.99


@pytest.mark.slow
@pytest.mark.parametrize("projection", ["direct", "modal"])
def test_200_intervals_cover_the_truth(projection):
    runs = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        record = ident.simulated(ident.THREE_DOF, ident.binary(3000, 3, seed), 0.25, "zoh", 20, rng)
        runs.append(N4sid(projection=projection).fit(record, Model(n=3)))
    assert 0.90 <= ident.covered(runs, ident.THREE_DOF, pack).mean() <= 0.99


def test_the_interval_counts_the_bias_of_the_wrong_hold():
    rng = np.random.default_rng(4)
    record = ident.simulated(ident.THREE_DOF, ident.smooth(3000, 0.25, 1.0, 3, rng), 0.25, "cubic", 30, rng)
    counted = N4sid().fit(record, Model(n=3))
    plain = N4sid(bias_in_interval=False).fit(record, Model(n=3))
    assert ident.covered([counted], ident.THREE_DOF, pack).mean() > 0.9
    assert ident.covered([plain], ident.THREE_DOF, pack).mean() < 0.5
    assert np.array_equal(counted.M, plain.M)


def test_a_record_too_short_for_blocks_has_no_standard_errors():
    rng = np.random.default_rng(4)
    record = ident.simulated(ident.ONE_DOF, ident.binary(150, 1, 0), 0.5, "zoh", 30, rng)
    assert N4sid(horizon=10).fit(record, Model(n=1)).covariance is None


@pytest.mark.slow
def test_200_intervals_cover_the_truth_of_a_smooth_input_behind_its_own_hold():
    runs = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        u = ident.smooth(3000, 0.25, 1.0, 3, rng)
        record = ident.simulated(ident.THREE_DOF, u, 0.25, "cubic", 20, rng)
        runs.append(N4sid(hold="record").fit(record, Model(n=3)))
    assert 0.90 <= ident.covered(runs, ident.THREE_DOF, pack).mean() <= 0.99


@pytest.mark.parametrize("c", [2.0, 4.0])
@pytest.mark.parametrize("projection", ["direct", "modal"])
def test_real_poles_and_a_double_one_too(c, projection):
    """A double pole makes the modal form defective: it is split by 1e-5, at the cost of some digits."""
    plant = (np.eye(1), c * np.eye(1), np.eye(1))
    clean = ident.simulated(plant, ident.binary(2000, 1, 1), 0.25, "zoh")
    assert ident.errors(N4sid(projection=projection).fit(clean, Model(n=1)), plant).max() < 1e-4
    noisy = ident.simulated(plant, ident.binary(2000, 1, 1), 0.25, "zoh", 30, np.random.default_rng(3))
    estimate = N4sid(projection=projection).fit(noisy, Model(n=1))
    assert ident.covered([estimate], plant, pack).all()
    assert estimate.std("K")[0, 0] < 0.05


def test_replicates_of_modes_that_do_not_correspond_are_fitted_again():
    plant = (np.eye(1), 2 * np.eye(1), np.eye(1))
    rng = np.random.default_rng(0)
    record = ident.simulated(plant, ident.smooth(2000, 0.25, 1.0, 1, rng), 0.25, "cubic", 25, rng)
    assert N4sid(hold="record").fit(record, Model(n=1)).std("K")[0, 0] < 0.1
