"""Hermitian matrices bin by bin -> sums over the bins of their Kronecker products, one block of M, D, K unknowns each.

Hermitian matrices are packed as their real upper and imaginary strictly upper triangles, which saves a factor of eight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from sysid_bench.mechanics.second_order import upper
from sysid_bench.nouns import Array, Complex

POWERS = (2, 1, 0)  # of s, for M, D, K
FEW_COLUMNS, AT_A_TIME = 4, 512  # of `grams`; the bins stay in the cache
TURN = (1, -1, -1, 1)  # Re j^m X = Re X, -Im X, -Re X, Im X for m = 0 .. 3


@lru_cache(maxsize=64)
def _flat_upper(n: int, above: int) -> Array:
    rows, columns = np.triu_indices(n, above)
    return rows * n + columns


def _where(n: int, hermitian: bool) -> tuple[Array, Array, Array]:
    """Index of the real and imaginary part of entry (i, j) in its packed row, and the sign of the latter."""
    if not hermitian:
        entry = np.arange(n * n).reshape(n, n)
        return entry, entry, np.ones((n, n))
    triangle, strict = np.triu_indices(n), np.triu_indices(n, 1)
    real, imag, sign = np.zeros((n, n), int), np.zeros((n, n), int), np.zeros((n, n))
    real[triangle] = real[triangle[::-1]] = np.arange(len(triangle[0]))
    imag[strict] = imag[strict[::-1]] = np.arange(len(strict[0]))
    sign[strict], sign[strict[::-1]] = 1.0, -1.0
    return real, imag, sign


class _Gathering(NamedTuple):
    """(u u, products) sparse: the block of unknowns (ij, kl) from the flat products of the packed parts of S and Omega:
    real x real and imaginary x imaginary for even powers of j, real x imaginary and imaginary x real for odd ones."""

    even: csr_array
    odd: csr_array


@lru_cache(maxsize=16)
def _gathering(n: int, wide: int, hermitian: bool) -> _Gathering:
    """S[i,k] Omega[j,l] + S[j,k] Omega[i,l] + S[i,l] Omega[j,k] + S[j,l] Omega[i,k], a repeated index once; i, k < n."""
    (s_real, s_imag, s_sign), (o_real, o_imag, o_sign) = _where(n, True), _where(wide, hermitian)
    ends = np.arange(n if wide > n else 0)
    i, j = (np.concatenate(x) for x in zip(upper(n), (ends, np.full(len(ends), n))))
    once, twice = np.ones(len(i)), ((i != j) & (j < n)).astype(float)
    parts: list[list[tuple[Array, Array]]] = [[], [], [], []]
    reals, imags = o_real.max() + 1, (wide * (wide - 1) // 2 if hermitian else wide * wide)
    for a, b, rows in ((i, j, once), (j, i, twice)):
        for c, d, columns in ((i, j, once), (j, i, twice)):
            ik, jl = np.ix_(a % n, c % n), np.ix_(b, d)
            share = np.outer(rows, columns)
            signs = (1.0, -s_sign[ik] * o_sign[jl], o_sign[jl], s_sign[ik])
            places = (
                s_real[ik] * reals + o_real[jl], s_imag[ik] * imags + o_imag[jl],
                s_real[ik] * imags + o_imag[jl], s_imag[ik] * reals + o_real[jl],
            )  # fmt: skip
            for part, sign, place in zip(parts, signs, places):
                part.append((share * sign, place))
    tall, high = parameters(n), n * (n - 1) // 2
    rr, ii, ri, ir = parts
    return _Gathering(
        _sparse((rr, ii), (tall * reals, high * imags)), _sparse((ri, ir), (tall * imags, high * reals))
    )


def _sparse(parts: Sequence[list[tuple[Array, Array]]], sizes: Sequence[int]) -> csr_array:
    """Two parts side by side, each a sum of terms (value, column) per row."""
    values = np.concatenate([share.ravel() for part in parts for share, _ in part])
    offsets = [0] * len(parts[0]) + [sizes[0]] * len(parts[1])
    places = [place for part in parts for _, place in part]
    columns = np.concatenate([place.ravel() + offset for place, offset in zip(places, offsets)])
    rows = np.tile(np.arange(places[0].size), len(places))
    kept = values != 0
    return csr_array((values[kept], (rows[kept], columns[kept])), shape=(places[0].size, sum(sizes)))


def _packed(X: Complex, hermitian: bool) -> tuple[Array, Array]:
    """Real and imaginary parts of (F, n, n), one row per bin."""
    F, n, _ = X.shape
    flat = X.reshape(F, n * n)
    if not hermitian:
        return flat.real, flat.imag
    return flat.real[:, _flat_upper(n, 0)], flat.imag[:, _flat_upper(n, 1)]


def parameters(n: int) -> int:
    """Entries of one symmetric n x n matrix."""
    return n * (n + 1) // 2


@dataclass(frozen=True, eq=False)
class Products:
    """Sums over some bins of omega^m times the packed parts of S and Omega, a row for each even, odd m from `lowest` to 4."""

    even: Array
    odd: Array
    lowest: int
    hermitian: bool
    n: int
    wide: int

    def __add__(self, other: Products) -> Products:
        sizes = self.lowest, self.hermitian, self.n, self.wide
        return Products(self.even + other.even, self.odd + other.odd, *sizes)

    def assembled(self, ends: tuple[int, ...] = ()) -> Array:
        """(3q + n e,)*2 real part of sum conj(s^b) s^c S Omega, symmetrised: all of M, D, K and of the ends, e powers of s."""
        to = _gathering(self.n, self.wide, self.hermitian)
        blocks = np.concatenate([(gather @ X.T).T.ravel() for gather, X in zip(to, (self.even, self.odd))])
        place, sign = _places(self.n, self.wide, self.lowest, ends)
        return blocks[place] * sign


@lru_cache(maxsize=64)
def _places(n: int, wide: int, lowest: int, ends: tuple[int, ...]) -> tuple[Array, Array]:
    """Where each entry of the assembled matrix stands among the blocks (u, u) of even, then of odd powers; its sign."""
    q, u = parameters(n), parameters(n) + (n if wide > n else 0)
    power = np.concatenate([np.repeat(POWERS, q), np.repeat(ends, n).astype(int)])
    entry = np.concatenate([np.tile(np.arange(q), 3), np.tile(q + np.arange(n), len(ends))])
    m = power[:, None] + power
    odd = m % 2
    block = (m - lowest - odd) // 2 + odd * len(range(lowest, 5, 2))
    return block * u * u + entry[:, None] * u + entry, (-1.0) ** power[:, None] * np.array(TURN)[m % 4]


def grams(G: Complex) -> Complex:
    """(F, n, n) G^H G bin by bin, G (F, ny, n); for few columns by products along the bins: BLAS takes longer to be called
    than to multiply them."""
    F, _, n = G.shape
    if n > FEW_COLUMNS:
        return np.conj(G).swapaxes(1, 2) @ G
    S = np.empty((F, n, n), dtype=complex)
    for k in range(0, F, AT_A_TIME):
        bins = slice(k, k + AT_A_TIME)
        rows = np.ascontiguousarray(G[bins].transpose(1, 2, 0))
        back = np.conj(rows)
        for i in range(n):
            S[bins, i, i:] = right = (back[:, i : i + 1] * rows[:, i:]).sum(axis=0).T
            S[bins, i + 1 :, i] = np.conj(right[:, 1:])
    return S


def products(S: Complex, Omega: Complex, omega: Array, hermitian: bool = True, lowest: int = 0) -> Products:
    """S (F, n, n) = (s^a C G)^H W (s^a C G), Hermitian; Omega (F, n, n), or with ends (F, n + 1, n + 1) = conj(q) q^T,
    Hermitian unless said; omega (F,) rad/s. lowest, even: the power of s down to which products are wanted."""
    Sr, Si = _packed(S, True)
    Or, Oi = _packed(Omega, hermitian)
    even, odd = _powers(omega, lowest), _powers(omega, lowest + 1)
    return Products(
        np.concatenate([_moments(Sr, Or, even), _moments(Si, Oi, even)], axis=1),
        np.concatenate([_moments(Sr, Oi, odd), _moments(Si, Or, odd)], axis=1),
        lowest,
        hermitian,
        S.shape[1],
        Omega.shape[1],
    )


def real_products(S: Array, share: Array, Omega: Complex, omega: Array, lowest: int = 0) -> Products:
    """The same for one real symmetric S (n, n) times share (F,)."""
    n, wide = len(S), Omega.shape[1]
    one = products((share + 0j)[:, None, None], Omega, omega, lowest=lowest)
    real, imaginary = S.ravel()[_flat_upper(n, 0)], n * (n - 1) // 2
    reals, imags = parameters(wide), wide * (wide - 1) // 2
    even, odd = ((real[:, None] * X[:, None, :]).reshape(len(X), -1) for X in (one.even, one.odd))
    return Products(_padded(even, imaginary * imags), _padded(odd, imaginary * reals), lowest, True, n, wide)


def _padded(X: Array, more: int) -> Array:
    return np.concatenate([X, np.zeros((len(X), more))], axis=1)


def with_ends(q: Complex, Q: Complex, w: Array) -> Complex:
    """Omega (F, n + 1, n + 1) = conj(q, w) (Q, w)^T."""
    one, other = (np.concatenate([x, w[:, None]], axis=1) for x in (q, Q))
    return np.conj(one)[:, :, None] * other[:, None, :]


def _powers(omega: Array, first: int) -> Array:
    """(P, F, 1) every second power of omega from `first` to 4."""
    scales, square = [omega**first], omega * omega
    for _ in range(first + 2, 5, 2):
        scales.append(scales[-1] * square)
    return np.stack(scales)[:, :, None]


def _moments(A: Array, B: Array, scales: Array) -> Array:
    """(P, a b) sum over bins of each of scales (P, F, 1) times A x B."""
    return ((scales * A).swapaxes(1, 2) @ B).reshape(len(scales), -1)
