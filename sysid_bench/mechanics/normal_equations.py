"""sensitivities -> information matrix and gradient of (M, D, K), never forming the sensitivities.

A row of sensitivities is -s^b (g_i q_j + g_j q_i), g_i the i-th column of C G(s). Its products are Kronecker:
J^H W J = sum_f s^(b+b') (G^H W G) x (conj(q) q^T): five sums of outer products of two Hermitian n x n
matrices give the whole block of n(n+1)3/2 parameters. Hermitian matrices are packed as their real upper and
imaginary strictly upper triangles, which saves a factor of eight.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from sysid_bench.nouns import Array, Complex

POWERS = (2, 1, 0)  # of s, for M, D, K


@lru_cache(maxsize=64)
def upper(n: int) -> tuple[Array, Array]:
    """Rows and columns, (n (n + 1)/2,) each, of the upper triangle by rows, as theta has them."""
    return np.triu_indices(n)


@lru_cache(maxsize=64)
def _strictly_upper(n: int) -> tuple[Array, Array]:
    return np.triu_indices(n, 1)


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
    """(q q, products) sparse: the block of parameters (ij, kl) from the flat products of the packed parts of S and Omega,
    real x real, imaginary x imaginary (for even powers of j), real x imaginary, imaginary x real (for odd ones)."""

    rr: csr_array
    ii: csr_array
    ri: csr_array
    ir: csr_array


@lru_cache(maxsize=16)
def _gathering(n: int, hermitian: bool) -> _Gathering:
    """S[i,k] Omega[j,l] + S[j,k] Omega[i,l] + S[i,l] Omega[j,k] + S[j,l] Omega[i,k], a repeated index once."""
    (s_real, s_imag, s_sign), (o_real, o_imag, o_sign) = _where(n, True), _where(n, hermitian)
    i, j = upper(n)
    once, twice = np.ones(len(i)), (i != j).astype(float)
    parts: list[list[tuple[Array, Array]]] = [[], [], [], []]
    width = o_imag.max(initial=-1) + 1 if n > 1 or not hermitian else 0
    for a, b, rows in ((i, j, once), (j, i, twice)):
        for c, d, columns in ((i, j, once), (j, i, twice)):
            ik, jl = np.ix_(a, c), np.ix_(b, d)
            share, wide = np.outer(rows, columns), o_real.max() + 1
            signs = (1.0, -s_sign[ik] * o_sign[jl], o_sign[jl], s_sign[ik])
            places = (
                s_real[ik] * wide + o_real[jl], s_imag[ik] * width + o_imag[jl],
                s_real[ik] * width + o_imag[jl], s_imag[ik] * wide + o_real[jl],
            )  # fmt: skip
            for part, sign, place in zip(parts, signs, places):
                part.append((share * sign, place))
    tall, high = s_real.max() + 1, len(_strictly_upper(n)[0])
    sizes = (tall * wide, high * width, tall * width, high * wide)
    return _Gathering(*(_sparse(part, size) for part, size in zip(parts, sizes)))


def _sparse(part: list[tuple[Array, Array]], size: int) -> csr_array:
    values = np.concatenate([share.ravel() for share, _ in part])
    columns = np.concatenate([place.ravel() for _, place in part])
    rows = np.tile(np.arange(part[0][0].size), len(part))
    kept = values != 0
    return csr_array((values[kept], (rows[kept], columns[kept])), shape=(part[0][0].size, size))


def _packed(X: Complex, hermitian: bool) -> tuple[Array, Array]:
    """Real and imaginary parts of (F, n, n), one row per bin."""
    if not hermitian:
        return X.real.reshape(len(X), -1), X.imag.reshape(len(X), -1)
    n = X.shape[1]
    return X[:, *upper(n)].real, X[:, *_strictly_upper(n)].imag


def parameters(n: int) -> int:
    """Entries of one symmetric n x n matrix."""
    return n * (n + 1) // 2


def information(S: Complex, Omega: Complex, omega: Array, hermitian: bool = True) -> Array:
    """(3q, 3q) real sum over f of conj(s^b) s^b' S[i,k] Omega[j,l], symmetrised; s = j omega.

    S (F, n, n) = (s^a C G)^H W (s^a C G), Hermitian; Omega (F, n, n) = conj(q) q^T, Hermitian unless said.
    """
    n = S.shape[1]
    Sr, Si = _packed(S, True)
    Or, Oi = _packed(Omega, hermitian)
    blocks, to, q = [], _gathering(n, hermitian), parameters(n)
    for m in range(5):
        scale = (omega**m)[:, None]
        real, imag = (Sr * scale).T, (Si * scale).T
        if m % 2 == 0:
            block = to.rr @ (real @ Or).ravel() + to.ii @ (imag @ Oi).ravel()
        else:
            block = to.ri @ (real @ Oi).ravel() + to.ir @ (imag @ Or).ravel()
        blocks.append(block.reshape(q, q))
    # conj(s^b) s^b' = (-1)^b j^(b+b') omega^(b+b'); Re(j^m X) = Re X, -Im X, -Re X, Im X for m = 0..3
    turn = (1, -1, -1, 1, 1)
    return np.block([[(-1) ** b * turn[b + c] * blocks[b + c] for c in POWERS] for b in POWERS])


def gradient(s: Complex, back: Complex, q: Complex) -> Array:
    """(3q,) real inner product of the sensitivities with a residual; back (F, n) = (s^a C G)^H W R."""
    return np.concatenate([_symmetric(np.conj(q * (s**b)[:, None]).T @ back) for b in POWERS])


def _symmetric(Z: Complex) -> Array:
    """vech of -(Z + Z^T), the diagonal once; Z[j, i]."""
    i, j = upper(len(Z))
    return -np.where(i == j, np.real(Z[j, i]), np.real(Z[j, i] + Z[i, j]))


def cross(s: Complex, q: Complex, back: Complex) -> Complex:
    """(3q, nt) inner products of the sensitivities with other columns; back (F, n, nt) = (s^a C G)^H W T."""
    F, n, nt = back.shape
    i, j = upper(n)
    motion = np.concatenate([np.conj(q * (s**b)[:, None]) for b in POWERS], axis=1)
    Z = (motion.T @ back.reshape(F, n * nt)).reshape(3, n, n, nt)  # b, j, i, t
    twice = (i != j)[None, :, None]
    return -(Z[:, j, i] + twice * Z[:, i, j]).reshape(-1, nt)
