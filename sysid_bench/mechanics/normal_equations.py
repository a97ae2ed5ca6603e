"""sensitivities -> information matrix and gradient of (M, D, K), never forming the sensitivities.

A row of sensitivities is -s^b (g_i q_j + g_j q_i), g_i the i-th column of C G(s). Its products are Kronecker:
J^H W J = sum_f s^(b+b') (G^H W G) x (conj(q) q^T): five sums of outer products of two Hermitian n x n
matrices give the whole block of n(n+1)3/2 parameters. Hermitian matrices are packed as their real upper and
imaginary strictly upper triangles, which saves a factor of eight.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sysid_bench.nouns import Array

Complex = NDArray[np.complex128]
POWERS = (2, 1, 0)  # of s, for M, D, K


@lru_cache(maxsize=64)
def _packing(n: int) -> tuple[tuple[Array, Array], tuple[Array, Array], tuple]:
    """Upper and strictly upper indices, and for each of four pairings where (i,k) and (j,l) are packed."""
    upper, strict = np.triu_indices(n), np.triu_indices(n, 1)
    real, imag, sign = np.zeros((n, n), int), np.zeros((n, n), int), np.zeros((n, n))
    real[upper] = real[upper[::-1]] = np.arange(len(upper[0]))
    imag[strict] = imag[strict[::-1]] = np.arange(len(strict[0]))
    sign[strict], sign[strict[::-1]] = 1.0, -1.0
    i, j = upper
    off = (i != j).astype(float)
    pairings = []
    for a, b, rows in ((i, j, np.ones(len(i))), (j, i, off)):
        for c, d, columns in ((i, j, np.ones(len(i))), (j, i, off)):
            ik, jl = (a[:, None], c[None, :]), (b[:, None], d[None, :])
            scale = rows[:, None] * columns[None, :]
            pairings.append(
                (real[ik], real[jl], imag[ik], imag[jl], sign[ik] * scale, sign[jl], scale)
            )
    return upper, strict, tuple(pairings)


def parameters(n: int) -> int:
    """Entries of one symmetric n x n matrix."""
    return n * (n + 1) // 2


def information(S: Complex, Omega: Complex, omega: Array) -> Array:
    """(3q, 3q) real sum over f of conj(s^b) s^b' S[i,k] Omega[j,l], symmetrised; s = j omega.

    S (F, n, n) = (s^a C G)^H W (s^a C G); Omega (F, n, n) = conj(q) q^T; both Hermitian.
    """
    n = S.shape[1]
    upper, strict, _ = _packing(n)
    Sr, Si = S[:, *upper].real, S[:, *strict].imag
    Or, Oi = Omega[:, *upper].real, Omega[:, *strict].imag
    rr, ii, ri, ir = {}, {}, {}, {}
    for m in range(5):
        scale = (omega**m)[:, None]
        if m % 2 == 0:
            rr[m], ii[m] = (Sr * scale).T @ Or, (Si * scale).T @ Oi
        else:
            ri[m], ir[m] = (Sr * scale).T @ Oi, (Si * scale).T @ Or
    blocks = {m: _even(rr[m], ii[m], n) if m % 2 == 0 else _odd(ri[m], ir[m], n) for m in range(5)}
    # conj(s^b) s^b' = (-1)^b j^(b+b') omega^(b+b'); Re(j^m X) = Re X, -Im X, -Re X, Im X for m = 0..3
    turn = (1, -1, -1, 1, 1)
    return np.block([[(-1) ** b * turn[b + c] * blocks[b + c] for c in POWERS] for b in POWERS])


def _even(rr: Array, ii: Array, n: int) -> Array:
    total = 0.0
    for rik, rjl, iik, ijl, sik, sjl, scale in _packing(n)[2]:
        total = total + scale * rr[rik, rjl]
        if n > 1:
            total = total - sik * sjl * ii[iik, ijl]
    return total


def _odd(ri: Array, ir: Array, n: int) -> Array:
    if n == 1:
        return np.zeros((1, 1))
    total = 0.0
    for rik, rjl, iik, ijl, sik, sjl, scale in _packing(n)[2]:
        total = total + scale * sjl * ri[rik, ijl] + sik * ir[iik, rjl]
    return total


def gradient(s: Complex, back: Complex, q: Complex) -> Array:
    """(3q,) real inner product of the sensitivities with a residual; back (F, n) = (s^a C G)^H W R."""
    return np.concatenate([_symmetric(np.conj(q * (s**b)[:, None]).T @ back) for b in POWERS])


def _symmetric(Z: Complex) -> Array:
    """vech of -(Z + Z^T), the diagonal once; Z[j, i]."""
    i, j = np.triu_indices(len(Z))
    return -np.where(i == j, Z[j, i].real, (Z[j, i] + Z[i, j]).real)


def cross(s: Complex, q: Complex, back: Complex) -> Complex:
    """(3q, nt) inner products of the sensitivities with other columns; back (F, n, nt) = (s^a C G)^H W T."""
    F, n, nt = back.shape
    i, j = np.triu_indices(n)
    motion = np.concatenate([np.conj(q * (s**b)[:, None]) for b in POWERS], axis=1)
    Z = (motion.T @ back.reshape(F, n * nt)).reshape(3, n, n, nt)  # b, j, i, t
    twice = (i != j)[None, :, None]
    return -(Z[:, j, i] + twice * Z[:, i, j]).reshape(-1, nt)
