"""a subspace estimate -> what it would have been without each block of the record, to first order in B.

The modes of each replicate come from the Gram matrix less the block's; the input rows from the score of
the block and from the change of the simulated output with the modes, so nothing of length N is simulated again.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.signal import lfilter

from sysid_bench.mechanics.hankel import hankel_gram, order_rows, safe_cholesky
from sysid_bench.mechanics.jackknife import blocks
from sysid_bench.mechanics.subspace import (
    HalfModes,
    InputFit,
    gradient,
    half_modes,
    observability,
    shift_invariance,
    solve_rows,
)
from sysid_bench.nouns import Array

Replicate = tuple[HalfModes, np.ndarray]


def replicates(
    z: Array, nu: int, i: int, weight: str, modes: HalfModes, fit: InputFit, wanted: int
) -> list[Replicate | None]:
    """(modes, beta) without each of `wanted` blocks of z = [u y] (N, nu + ny); [] for short records.

    None where they cannot be had: without noise, and where modes merge or split between replicates.
    """
    parts = blocks(len(z) - 2 * i + 1, wanted, 4 * i)
    changed = _modes_without(z, nu, i, weight, modes, parts)
    moves = _row_moves(modes, fit, _sample_blocks(parts, i, len(z)), changed)
    return [None if m is None else (m, fit.beta + move) for m, move in zip(changed, moves)]


def _sample_blocks(parts: list[slice], i: int, N: int) -> list[slice]:
    """Blocks of samples around the middles of the Hankel windows."""
    if not parts:
        return []
    edges = [0, *(part.start + i for part in parts[1:]), N]
    return [slice(a, b) for a, b in pairwise(edges)]


def _modes_without(
    z: Array, nu: int, i: int, weight: str, modes: HalfModes, parts: list[slice]
) -> list[HalfModes | None]:
    ny, s = z.shape[1] - nu, 2 * i
    order = np.ix_(*[order_rows(nu, ny, i)] * 2)
    grams = [hankel_gram(z[part.start : part.stop + s - 1], s)[order] for part in parts]
    total, nx = sum(grams), int(modes.weight.sum())
    return [_matched(safe_cholesky(total - gram), nu, ny, i, nx, weight, modes) for gram in grams]


def _matched(
    R: Array | None, nu: int, ny: int, i: int, nx: int, weight: str, modes: HalfModes
) -> HalfModes | None:
    """The replicate's modes in the order and scale of the estimate's, None where they do not correspond."""
    if R is None:
        return None
    Gamma, _ = observability(R, nu, ny, i, weight)
    found = half_modes(*shift_invariance(Gamma[:, :nx], ny))
    if len(found.p) != len(modes.p) or sorted(found.weight) != sorted(modes.weight):
        return None
    _, order = linear_sum_assignment(np.abs(modes.p[:, None] - found.p[None, :]))
    if not np.array_equal(found.weight[order], modes.weight):
        return None
    c = found.c[:, order]
    c = c / c[np.abs(modes.c).argmax(axis=0), np.arange(len(order))]
    return HalfModes(found.p[order], c, modes.weight, found.reflected)


def _row_moves(
    modes: HalfModes, fit: InputFit, parts: list[slice], changed: list[HalfModes | None]
) -> list[np.ndarray]:
    """beta(replicate) - beta, (k, nu + 1) each: N^-1 (- score of the block - J^T dy of the moved modes)."""
    q, J, xi = fit.beta.shape[1], len(parts), fit.xi
    z = np.einsum("tkj,kj->tk", xi.reshape(len(xi), -1, q), fit.beta)
    slope = np.stack([lfilter([0, 1.0], [1.0, -p], z[:, k]) for k, p in enumerate(modes.p)], axis=1)
    real, imaginary = xi.T @ np.hstack([z.real, slope.real]), xi.T @ np.hstack([z.imag, slope.imag])
    moves = []
    for part, new in zip(parts, changed):
        new = modes if new is None else new
        score = xi[part].T @ fit.residual[part] * (J / (J - 1))
        dc = np.tile(modes.weight, 2) * np.hstack([new.c - modes.c, modes.c * (new.p - modes.p)])
        shift = real @ dc.real.T - imaginary @ dc.imag.T
        moves.append(solve_rows(modes, fit.normal, -gradient(modes, score + shift, q), q))
    return moves
