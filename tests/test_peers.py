"""Peers: absent ones are named with the way out, present ones fit."""

import importlib.util
import shutil

import numpy as np
import pytest

from sysid_bench.mechanics.black_box import estimate_of_black_box, peer_module
from sysid_bench.mechanics.conversion import c2d_zoh
from sysid_bench.mechanics.holds import propagate
from sysid_bench.mechanics.second_order import state_space
from sysid_bench.methods.peer_nfoursid import PeerNfoursid
from sysid_bench.methods.peer_octave import PeerOctave
from sysid_bench.methods.peer_sippy import PeerSippy
from sysid_bench.nouns import Diverged, Model, NotApplicable, Record

M, D, K = np.diag([1.0, 1.2]), np.array([[0.4, -0.1], [-0.1, 0.3]]), np.array([[4.0, -1.0], [-1.0, 3.0]])
H = 0.2


def white_record() -> Record:
    u = np.random.default_rng(0).standard_normal((1500, 2))
    A, B, C, _ = state_space(M, D, K)
    y = propagate(A, B, u, H, "zoh") @ C.T
    return Record(H * np.arange(1500), u, y + 1e-3 * np.random.default_rng(1).standard_normal(y.shape), "zoh")


def test_an_absent_package_is_named_with_the_way_out() -> None:
    with pytest.raises(NotApplicable, match=r"not installed: pip install sysid-bench\[peers\]"):
        peer_module("no_such_package_here", "something")


def test_a_black_box_is_projected() -> None:
    A, B, C, Dd = state_space(M, D, K)
    estimate = estimate_of_black_box(*c2d_zoh(A, B, H), C, Dd, H, Model(n=2), {})
    assert np.allclose(estimate.M, M) and np.allclose(estimate.D, D) and np.allclose(estimate.K, K)
    with pytest.raises(Diverged, match="finite"):
        estimate_of_black_box(np.full((4, 4), np.nan), B, C, Dd, H, Model(n=2), {})


@pytest.mark.parametrize(
    ("method", "present"),
    [
        (PeerOctave(), shutil.which("octave-cli") is not None),
        (PeerNfoursid(), importlib.util.find_spec("nfoursid") is not None),
        (PeerSippy(horizon=6), importlib.util.find_spec("sippy_unipi") is not None),
    ],
    ids=["octave", "nfoursid", "sippy"],
)
def test_a_peer_fits_or_says_that_it_is_absent(method, present: bool) -> None:
    if not present:
        with pytest.raises(NotApplicable, match="not installed"):
            method.fit(white_record(), Model(n=2))
        return
    estimate = method.fit(white_record(), Model(n=2))
    truth = np.linalg.eigvals(state_space(M, D, K)[0])
    assert np.allclose(np.sort(np.abs(estimate.poles)), np.sort(np.abs(truth)), rtol=0.05)
