"""The midpoint map: linear and invertible, structure and passivity, the start (4.15)."""

import identification as ident
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sysid_bench.mechanics import cayley
from sysid_bench.mechanics.conversion import c2d_zoh, modes
from sysid_bench.mechanics.holds import propagate
from sysid_bench.mechanics.second_order import state_space
from sysid_bench.nouns import Model, NotApplicable


@given(h=st.floats(1e-3, 2.0), seed=st.integers(0, 1000), n=st.integers(1, 5))
@settings(max_examples=40, deadline=None)
def test_2_26_undoes_2_22_and_keeps_symmetry(h, seed, n):
    M, D, K = (X + X.T for X in np.random.default_rng(seed).standard_normal((3, n, n)))
    discrete = cayley.to_discrete(M, D, K, h)
    assert all(np.array_equal(X, X.T) for X in discrete)
    for X, Y in zip(cayley.to_continuous(*discrete, h), (M, D, K)):
        assert np.allclose(X, Y, rtol=1e-9, atol=1e-7)


def test_the_difference_equation_is_the_midpoint_recursion():
    h, u = 0.3, ident.binary(60, 3, 0)
    Md, Dd, Kd = cayley.to_discrete(*ident.UNEVEN, h)
    A, B, C, _ = state_space(*ident.UNEVEN)
    q = propagate(A, B, u, h, "cayley") @ C.T
    left = q[2:] @ Md + q[1:-1] @ Dd + q[:-2] @ Kd
    assert np.allclose(left, cayley.discrete_force(u, np.eye(3), h), atol=1e-12)


def test_the_cayley_transform_is_the_bilinear_substitution_and_invertible():
    h, continuous = 0.2, state_space(*ident.UNEVEN)
    discrete = cayley.cayley(*continuous, h)
    A, B, C, D = continuous
    Ad, Bd, Cd, Dd = discrete
    z = np.exp(0.7j)
    s = 2 / h * (z - 1) / (z + 1)
    at_s = C @ np.linalg.solve(s * np.eye(6) - A, B) + D
    at_z = Cd @ np.linalg.solve(z * np.eye(6) - Ad, Bd) + Dd
    assert np.allclose(at_s, at_z, atol=1e-12)
    for X, Y in zip(cayley.inverse_cayley(*discrete, h), continuous):
        assert np.allclose(X, Y, atol=1e-10)


def test_the_midpoint_rule_conserves_the_energy_of_a_lossless_system_exactly():
    M, _, K = ident.UNEVEN
    A, B, _, _ = state_space(M, 0 * M, K)
    x = propagate(A, B, np.zeros((5000, 3)), 0.5, "cayley", np.ones(6))
    energy = np.einsum("ti,ij,tj->t", x[:, :3], K, x[:, :3]) + np.einsum("ti,ij,tj->t", x[:, 3:], M, x[:, 3:])
    assert np.allclose(energy, energy[0], rtol=1e-10)


def start_error(h, printed):
    A, B, C, _ = state_space(*ident.THREE_DOF)
    form = modes(*c2d_zoh(A, B, h), C)
    M, _, _ = cayley.midpoint_start(form, Model(n=3), h, printed=printed)
    return np.linalg.norm(M - ident.THREE_DOF[0]) / np.linalg.norm(ident.THREE_DOF[0])


def test_4_15_lacks_one_over_h():
    assert start_error(0.05, printed=False) < 0.01
    assert start_error(0.05, printed=True) == pytest.approx(19.0, rel=0.02)


def test_4_15_tends_to_the_plant_with_h():
    assert start_error(0.01, printed=False) < 0.05 * start_error(0.1, printed=False)


def test_the_start_declines_partial_actuation():
    A, B, C, _ = state_space(*ident.UNEVEN, np.eye(3)[:, :1])
    with pytest.raises(NotApplicable, match="independent forces"):
        cayley.midpoint_start(modes(*c2d_zoh(A, B, 0.1), C), Model(n=3, input_map=np.eye(3)[:, :1]), 0.1)
