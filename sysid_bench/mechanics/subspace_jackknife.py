"""a subspace estimate -> what it would have been without each block of the record, to first order in B.

The modes of each replicate come from the Gram matrix less the block's; the input rows from the score of
the block and from the change of the simulated output with the modes, so nothing of length N is simulated again
(while the modes stay apart).
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.signal import lfilter

from sysid_bench.mechanics.hankel import hankel_gram, order_rows, safe_cholesky
from sysid_bench.mechanics.jackknife import blocks
from sysid_bench.mechanics.subspace import (
    HalfModes,
    InputFit,
    fit_inputs,
    gradient,
    half_modes,
    observability,
    shift_invariance,
    solve_rows,
)
from sysid_bench.nouns import Array

Replicate = tuple[HalfModes, np.ndarray]
# Complex regressors up to which fitting the input rows of every replicate again takes little time.
REFITTED_COLUMNS = 16

Drives = Callable[[HalfModes], np.ndarray | None]


def replicates(
    z: Array,
    nu: int,
    i: int,
    weight: str,
    modes: HalfModes,
    fit: InputFit,
    drives: Drives,
    wanted: int,
) -> list[Replicate | None]:
    """(modes, beta) without each of `wanted` blocks of z = [u y] (N, nu + ny); [] for short records.

    None where a block less leaves nothing to factor, as without noise. Where modes merge, split or move by much
    of their distance between the replicates, the first order is no use: then the input rows are fitted again, if
    that is cheap; else such replicates are None.
    """
    parts = blocks(len(z) - 2 * i + 1, wanted, 4 * i)
    if not parts:
        return []
    found = _modes_without(z, nu, i, weight, int(modes.weight.sum()), parts)
    samples = _sample_blocks(parts, i, len(z))
    alike = [None if m is None else _matched(m, modes) for m in found]
    small = fit.beta.size <= REFITTED_COLUMNS
    if small and not all(m is not None and _near(m, modes) for m in alike):
        return [
            None if m is None else (m, _refitted(m, z, nu, fit, drives, part))
            for m, part in zip(found, samples)
        ]
    moves = _row_moves(modes, fit, samples, [modes if m is None else m for m in alike])
    return [None if m is None else (m, fit.beta + move) for m, move in zip(alike, moves)]


def _refitted(modes: HalfModes, z: Array, nu: int, fit: InputFit, drives: Drives, part: slice) -> np.ndarray:
    keep = np.ones(len(z), dtype=bool)
    keep[part] = False
    return fit_inputs(modes, z[:, :nu], z[:, nu:], fit.feedthrough is not None, drives(modes), keep).beta


def _sample_blocks(parts: list[slice], i: int, N: int) -> list[slice]:
    """Blocks of samples around the middles of the Hankel windows."""
    edges = [0, *(part.start + i for part in parts[1:]), N]
    return [slice(a, b) for a, b in pairwise(edges)]


def _modes_without(
    z: Array, nu: int, i: int, weight: str, nx: int, parts: list[slice]
) -> list[HalfModes | None]:
    ny, s = z.shape[1] - nu, 2 * i
    order = np.ix_(*[order_rows(nu, ny, i)] * 2)
    grams = [hankel_gram(z[part.start : part.stop + s - 1], s)[order] for part in parts]
    total, found = sum(grams), []
    for gram in grams:
        R = safe_cholesky(total - gram)
        Gamma = None if R is None else observability(R, nu, ny, i, weight)[0][:, :nx]
        found.append(None if Gamma is None else half_modes(*shift_invariance(Gamma, ny)))
    return found


def _matched(found: HalfModes, modes: HalfModes) -> HalfModes | None:
    """The replicate's modes in the order and scale of the estimate's, None where they do not correspond."""
    if sorted(found.weight) != sorted(modes.weight):
        return None
    _, order = linear_sum_assignment(np.abs(modes.p[:, None] - found.p[None, :]))
    if not np.array_equal(found.weight[order], modes.weight):
        return None
    c = found.c[:, order]
    c = c / c[np.abs(modes.c).argmax(axis=0), np.arange(len(order))]
    return HalfModes(found.p[order], c, modes.weight, found.reflected)


def _near(found: HalfModes, modes: HalfModes) -> bool:
    """Whether no pole has moved by more than a fifth of its distance to the next one."""
    others = np.concatenate([modes.p, modes.p[~modes.real].conj()])
    distance = np.abs(modes.p[:, None] - others[None, :])
    np.fill_diagonal(distance, np.inf)
    return bool(np.all(np.abs(found.p - modes.p) < 0.2 * distance.min(axis=1)))


def _row_moves(modes: HalfModes, fit: InputFit, parts: list[slice], changed: list[HalfModes]) -> np.ndarray:
    """beta(replicate) - beta, (J, k, nu + 1): N^-1 (- score of the block - J^T dy of the moved modes)."""
    q, J, xi = fit.beta.shape[1], len(parts), fit.xi
    z = np.einsum("tkj,kj->tk", xi.reshape(len(xi), -1, q), fit.beta)
    slope = np.stack([lfilter([0, 1.0], [1.0, -p], z[:, k]) for k, p in enumerate(modes.p)], axis=1)
    real, imaginary = (xi.T @ np.hstack([part(z), part(slope)]) for part in (np.real, np.imag))
    gradients = []
    for part, new in zip(parts, changed):
        score = xi[part].T @ fit.residual[part] * (J / (J - 1))
        dc = np.tile(modes.weight, 2) * np.hstack([new.c - modes.c, modes.c * (new.p - modes.p)])
        shift = real @ np.real(dc).T - imaginary @ np.imag(dc).T
        gradients.append(-gradient(modes, score + shift, q))
    return solve_rows(modes, fit.normal, np.array(gradients), q)
