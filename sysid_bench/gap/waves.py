"""motion, force -> how well waves of position match the force, and the waves thinned: what ranks pitches."""

from __future__ import annotations

import numba as nb
import numpy as np

from sysid_bench.mechanics.compiled import UNCOUNTED
from sysid_bench.nouns import Array


def wave(ks: Array, x: Array) -> np.ndarray:
    """(nk, N) exp(i k x)"""
    turn = (ks[:, None] * x).astype(np.float32)
    out = np.empty(turn.shape, dtype=np.complex64)
    out.real, out.imag = np.cos(turn), np.sin(turn)
    return out


def waves(ks: Array, x: Array, force: Array, fold: int) -> tuple[Array, np.ndarray]:
    """|sum force exp(i k x)|^2 (nk,), and sums (nk, N // fold) of exp(i k x) over `fold` neighbours, for ascending ks.

    Each wave comes from the one before: a product costs a tenth of an exponential. In single precision: they only rank.
    """
    long = len(x) // fold * fold
    steps, which = np.unique(
        [float(f"{step:.6g}") for step in np.diff(ks, prepend=ks[0])], return_inverse=True
    )
    x, rest = x[:long].reshape(-1, fold).T.reshape(-1), x[long:]
    first, turns = wave(ks[:1], x), wave(steps, x)
    beside = force[:long].reshape(-1, fold).T.astype(np.float32)
    sums, hits = np.zeros((2, len(ks), long // fold), np.float32), np.empty((2, len(ks)), np.float32)
    now, turns = np.concatenate([np.real(first), np.imag(first)]), np.stack([np.real(turns), np.imag(turns)])
    _waves(now, turns, which, beside, sums, hits)
    total = hits[0] + 1j * hits[1] + np.exp(1j * ks[:, None] * rest) @ force[long:]
    return np.abs(total) ** 2, sums[0] + 1j * sums[1]


@nb.njit(**UNCOUNTED, fastmath=True)
def _waves(now, turns, which, force, sums, hits):
    """now (2, fold M): cosine and sine, turned by turns[:, which[k]] for the k-th wave; loops as a compiler widens them."""
    fold, M = force.shape
    for k in range(len(which)):
        step, real, imaginary = which[k], np.float32(0.0), np.float32(0.0)
        for p in range(fold):
            first = p * M
            for m in range(M):
                c, s = now[0, first + m], now[1, first + m]
                a, b = turns[0, step, first + m], turns[1, step, first + m]
                u, v = c * a - s * b, c * b + s * a
                now[0, first + m], now[1, first + m] = u, v
                real += u * force[p, m]
                imaginary += v * force[p, m]
        hits[0, k], hits[1, k] = real, imaginary
        for part in range(2):
            for p in range(fold):
                for m in range(M):
                    sums[part, k, m] += now[part, p * M + m]
