"""What maximum likelihood is summed from: turns in place of transforms, one more motion in place of columns, Cholesky."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.fft import rfft
from scipy.interpolate import CubicSpline

from sysid_bench.mechanics.hold_spectra import drive_spectra
from sysid_bench.mechanics.kronecker import products, real_products, with_ends
from sysid_bench.mechanics.normal_equations import BLIND, ends_of, gram_of_ends
from sysid_bench.mechanics.rules import rule, spline_slopes
from sysid_bench.mechanics.second_order import upper
from sysid_bench.mechanics.semidefinite import solved

ENDS = (2, 1, 0, -1, -2)


def complex_normal(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.standard_normal(shape) + 1j * rng.standard_normal(shape)


@pytest.mark.parametrize("N", [60, 61])
@pytest.mark.parametrize("hold", ["zoh", "foh", "cubic"])
def test_spectra_of_a_hold_are_those_of_its_coefficients(hold: str, N: int) -> None:
    u = np.random.default_rng(0).standard_normal((N, 2))
    c = rule(hold).coefficients(u)
    wanted = rfft(np.concatenate([c, 0 * c[:, :1]], axis=1), axis=1).swapaxes(0, 1)
    z = np.exp(2j * np.pi * np.arange(N // 2 + 1) / N)[:, None]
    found = drive_spectra(u, rfft(u, axis=0), z, np.ones((len(z), 1)), hold)
    assert np.allclose(found, wanted, atol=1e-12)


@pytest.mark.parametrize("N", [4, 5, 50])
def test_slopes_are_those_of_the_spline(N: int) -> None:
    u = np.random.default_rng(1).standard_normal((N, 2))
    knots = np.arange(N)
    assert np.allclose(spline_slopes(u), CubicSpline(knots, u)(knots, 1), atol=1e-12)


@pytest.mark.parametrize("n", [1, 3])
@pytest.mark.parametrize("hermitian", [True, False])
def test_sums_of_products_are_those_of_the_columns(n: int, hermitian: bool) -> None:
    rng = np.random.default_rng(n)
    F, (i, j) = 7, upper(n)
    omega, w, G = 1 + np.arange(F), rng.random(F), complex_normal(rng, F, n, n)
    q, other = complex_normal(rng, F, n), complex_normal(rng, F, n)
    Q = q if hermitian else other

    def columns(motion: np.ndarray) -> np.ndarray:
        once = np.where(i == j, 0.0, 1.0)
        pairs = G[:, :, i] * motion[:, None, j] + once * G[:, :, j] * motion[:, None, i]
        s = 1j * omega[:, None, None]
        return np.concatenate(
            [*(pairs * s**b for b in (2, 1, 0)), *(G * w[:, None, None] * s**c for c in ENDS)], axis=2
        )

    S = np.conj(G).swapaxes(1, 2) @ G
    found = products(S, with_ends(q, Q, w), omega.astype(float), hermitian, -4).assembled(ENDS)
    wanted = np.einsum("fya,fyb->ab", np.conj(columns(q)), columns(Q)).real
    assert np.allclose(found, wanted, rtol=1e-10, atol=1e-10 * np.abs(wanted).max())
    ends = wanted[-n * len(ENDS) :, -n * len(ENDS) :]
    assert np.allclose(gram_of_ends(ends_of(1j * omega, w, ENDS), S), ends, rtol=1e-10)


def test_one_real_matrix_in_all_bins_gives_the_same_sums() -> None:
    rng = np.random.default_rng(5)
    S, share, omega = np.array([[2.0, 0.5], [0.5, 1.0]]), rng.random(6), 1.0 + np.arange(6)
    Omega = with_ends(*2 * [complex_normal(rng, 6, 2)], rng.random(6))
    wanted = products(share[:, None, None] * (S + 0j), Omega, omega).assembled((1, 0))
    assert np.allclose(real_products(S, share, Omega, omega).assembled((1, 0)), wanted, rtol=1e-12)


def test_a_solution_is_exact_where_there_is_one_and_of_least_norm_where_there_are_many() -> None:
    rng = np.random.default_rng(6)
    units = np.array([1e-6, 1.0, 1e6, 1.0])
    J, x = rng.standard_normal((20, 4)) * units, rng.standard_normal(4) / units
    A = J.T @ J
    assert np.allclose(solved(A, A @ x, BLIND), x, rtol=1e-9)
    assert np.allclose(solved(A, A @ np.diag(x), BLIND) * units[:, None], np.diag(x * units), atol=1e-9)
    twice = np.ones((2, 2))
    assert np.allclose(solved(twice, np.array([2.0, 2.0]), BLIND), [1.0, 1.0])
