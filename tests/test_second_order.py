"""Packing, state space, poles and modes against first principles and the papers' plants."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from sysid_bench.build import build
from sysid_bench.mechanics import second_order as so
from sysid_bench.nouns import InputError, Model

CONF = Path(__file__).parents[1] / "conf" / "plant"
LINEAR = ["one_dof", "one_dof_undamped", "one_dof_critical", "one_dof_overdamped", "three_dof", "eight_dof"]


def plant(name):
    return build(yaml.safe_load((CONF / f"{name}.yaml").read_text()))


@pytest.mark.parametrize("name", LINEAR)
def test_pack_and_unpack_are_inverse(name):
    p = plant(name)
    theta = so.pack(p.mass, p.damping, p.stiffness)
    assert theta.shape == (so.ntheta(p.n),)
    for X, Y in zip(so.unpack(theta, p.n), (p.mass, p.damping, p.stiffness)):
        assert np.array_equal(X, Y)


def test_pack_takes_upper_triangles_by_rows():
    M = np.array([[1.0, 2, 3], [2, 4, 5], [3, 5, 6]])
    assert list(so.pack(M, 10 * M, 100 * M)[:9]) == [1, 2, 3, 4, 5, 6, 10, 20, 30]
    assert so.pairs(3) == [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]


def test_free_mask_follows_the_model():
    model = Model(np.eye(2), np.eye(2), np.eye(2), free={"mass": [[False, False], [False, True]]})
    assert so.free_mask(model).tolist() == [False, False, True] + 6 * [True]


@pytest.mark.parametrize("name", LINEAR)
def test_state_space_is_the_transfer_matrix(name):
    p, s = plant(name), 0.3 + 2.7j
    L, C = np.arange(1.0, p.n + 1)[:, None], np.ones((1, p.n))
    G = C @ np.linalg.solve(p.mass * s**2 + p.damping * s + p.stiffness, L)
    for power, output in enumerate(("displacement", "velocity", "acceleration")):
        A, B, Cx, Dx = so.state_space(p.mass, p.damping, p.stiffness, L, C, output)
        H = Cx @ np.linalg.solve(s * np.eye(2 * p.n) - A, B) + Dx
        assert np.allclose(H, s**power * G, rtol=1e-10)


def test_unknown_output_is_refused():
    with pytest.raises(InputError, match="jerk"):
        so.state_space(np.eye(1), np.eye(1), np.eye(1), output="jerk")


def test_the_papers_plants_have_the_papers_modes():
    p = plant("three_dof")
    omega_n, zeta = so.frequencies_and_damping(so.poles(p.mass, p.damping, p.stiffness))
    assert np.allclose(omega_n, [1.173, 1.848, 2.355], atol=1e-3)
    assert np.allclose(zeta, [0.0587, 0.0924, 0.1177], atol=1e-4)
    p = plant("eight_dof")
    omega_n, zeta = so.frequencies_and_damping(so.poles(p.mass, p.damping, p.stiffness))
    assert np.allclose(omega_n, [5.59, 9.74, 11.14, 14.74, 15.70, 17.17, 18.42, 20.43], atol=6e-3)
    assert np.isclose(zeta[0], 0.0149, atol=1e-4) and np.isclose(zeta[-1], 0.0513, atol=1e-4)


@pytest.mark.parametrize(
    ("name", "zeta"), [("one_dof_undamped", [0]), ("one_dof", [0.5]), ("one_dof_overdamped", [1, 1])]
)
def test_damping_ratios_of_one_dof(name, zeta):
    p = plant(name)
    assert np.allclose(
        so.frequencies_and_damping(so.poles(p.mass, p.damping, p.stiffness))[1], zeta, atol=1e-12
    )


def test_a_rigid_body_has_frequency_and_damping_zero():
    omega_n, zeta = so.frequencies_and_damping(np.zeros(2))
    assert omega_n.tolist() == [0, 0] and zeta.tolist() == [0, 0]


@pytest.mark.parametrize("name", ["one_dof", "one_dof_overdamped", "three_dof", "eight_dof"])
def test_modes_rebuild_the_matrix(name):
    p = plant(name)
    A = so.companion(p.mass, p.damping, p.stiffness)
    modes = so.modes(A)
    rebuilt = ((modes.V * (modes.weight * modes.lam)) @ modes.W).real
    assert not modes.defective and np.allclose(rebuilt, A, rtol=0, atol=1e-9 * np.abs(A).max())


def test_defective_matrices_are_seen():
    p = plant("one_dof_critical")
    assert so.modes(so.companion(p.mass, p.damping, p.stiffness)).defective
    assert so.modes(so.companion(np.eye(1), np.zeros((1, 1)), np.zeros((1, 1)))).defective
    assert not so.modes(so.companion(np.eye(2), 0.1 * np.eye(2), np.eye(2))).defective


def test_undamped_modes_diagonalise_both_matrices():
    p = plant("eight_dof")
    omega_n, shapes = so.undamped_modes(p.mass, p.stiffness)
    assert np.allclose(shapes.T @ p.mass @ shapes, np.eye(8))
    assert np.allclose(shapes.T @ p.stiffness @ shapes, np.diag(omega_n**2), atol=1e-9)
