"""Continuous modal form -> M, D, K."""

import identification as ident
import numpy as np
import pytest

from sysid_bench.mechanics.conversion import c2d_zoh, d2c, hold_weights, modes
from sysid_bench.mechanics.projection import project
from sysid_bench.mechanics.second_order import state_space
from sysid_bench.nouns import Diverged, Model, NotApplicable

SENSORS = np.array([[1.0, 0.5, 0], [0, 1, -0.3], [0.2, 0, 1]])
FORCES = np.array([[1.0, 0, 0.4], [0.3, 2, 0], [0, 0, 1]])


@pytest.mark.parametrize("projection", ["direct", "modal"])
@pytest.mark.parametrize("output", ["displacement", "velocity", "acceleration"])
def test_exact_modes_give_the_matrices_back_through_any_maps(projection, output):
    A, B, C, _ = state_space(*ident.UNEVEN, FORCES, SENSORS, output)
    model = Model(n=3, input_map=FORCES, output_map=SENSORS, output=output)
    for X, Y in zip(project(modes(A, B, C), model, projection), ident.UNEVEN):
        assert np.allclose(X, Y, rtol=1e-9, atol=1e-10)


def test_the_modal_projection_takes_a_single_force_the_direct_one_says_no():
    L = np.array([[1.0], [0.2], [0.1]])
    A, B, C, _ = state_space(*ident.UNEVEN, L)
    model, form = Model(n=3, input_map=L), modes(A, B, C)
    for X, Y in zip(project(form, model, "modal"), ident.UNEVEN):
        assert np.allclose(X, Y, rtol=1e-8, atol=1e-9)
    with pytest.raises(NotApplicable, match="independent forces"):
        project(form, model, "direct")


def test_too_few_sensors_and_wrong_orders_are_declined():
    A, B, C, _ = state_space(*ident.UNEVEN)
    with pytest.raises(NotApplicable, match="order 6"):
        project(tuple(X for X in modes(A[:2, :2], B[:2], C[:, :2])), Model(n=3), "direct")
    with pytest.raises(NotApplicable, match="sensors"):
        project(modes(A, B, C[:2]), Model(n=3, output_map=np.eye(3)[:2]), "modal")


def test_more_sensors_and_forces_than_degrees_of_freedom():
    L, C = np.hstack([FORCES, np.ones((3, 1))]), np.vstack([SENSORS, np.ones((1, 3))])
    A, B, Cx, _ = state_space(*ident.UNEVEN, L, C)
    for projection in ("direct", "modal"):
        found = project(modes(A, B, Cx), Model(n=3, input_map=L, output_map=C), projection)
        assert all(np.allclose(X, Y, rtol=1e-9, atol=1e-10) for X, Y in zip(found, ident.UNEVEN))


@pytest.mark.parametrize("h", [1e-3, 0.1, 1.0])
def test_d2c_undoes_the_zero_order_hold(h):
    A, B, C, _ = state_space(*ident.UNEVEN)
    p, c, b = modes(*c2d_zoh(A, B, h), C)
    lam, bc = d2c(p, b, h)
    assert np.allclose(np.sort_complex(lam), np.sort_complex(np.linalg.eigvals(A)), rtol=1e-9)
    assert np.allclose(((c * lam) @ bc).real, np.linalg.inv(ident.UNEVEN[0]), atol=1e-8)


def test_a_negative_real_pole_has_no_logarithm():
    with pytest.raises(Diverged, match="no real continuous-time counterpart"):
        d2c(np.array([-0.5 + 0j, 0.5]), np.ones((2, 1)), 0.1)


@pytest.mark.parametrize("hold", ["zoh", "foh", "cubic"])
def test_hold_weights_tend_to_the_sampling_time(hold):
    lam = np.array([-0.1 + 2j, -0.1 - 2j, 0.0])
    assert np.allclose(hold_weights(lam, 1e-6, hold), 1e-6, rtol=1e-5)


def test_a_smooth_input_behind_zoh_ruins_the_damping_of_the_modal_projection():
    """Residues R exp(lam h/2) give Phi Phi^T != 0: an error of D of about ||K|| h / (2 ||D||)."""
    A, B, C, _ = state_space(*ident.THREE_DOF)
    lam, c, b = modes(A, B, C)
    h = 0.0125
    late = (lam, c, b * np.exp(lam * h / 2)[:, None])
    _, D, _ = project(late, Model(n=3), "modal")
    error = np.linalg.norm(D - ident.THREE_DOF[1]) / np.linalg.norm(ident.THREE_DOF[1])
    assert error == pytest.approx(0.0625, rel=0.05)
    _, D, _ = project(late, Model(n=3), "direct")
    assert np.linalg.norm(D - ident.THREE_DOF[1]) < 0.1 * np.linalg.norm(ident.THREE_DOF[1])
