"""spectra of forces at one place -> the screen's rows: filtered by the plant, whitened and thinned in one pass."""

from __future__ import annotations

import numba as nb
import numpy as np

from sysid_bench.gap.basis import sketch
from sysid_bench.gap.motion import Seen
from sysid_bench.mechanics.compiled import UNCOUNTED
from sysid_bench.nouns import Array


def place_rows(seens: list[Seen], c: Array, spectra: list[np.ndarray]) -> Array:
    """(rows, m) thinned rows, as basis.stack makes them of columns.force_columns; spectra: per trace (F, m) of the forces."""
    return np.concatenate([_of_one(s, c, X) for s, X in zip(seens, spectra)])


def _of_one(s: Seen, c: Array, X: np.ndarray) -> Array:
    arm = -(s.G[:, :, : len(c)] @ c) * s.trace.weight
    fold, signs = sketch(2 * arm.size)
    out = np.zeros((-(-2 * arm.size // fold), X.shape[1]))
    _fill(arm, np.ascontiguousarray(np.real(X)), np.ascontiguousarray(np.imag(X)), signs, fold, out)
    return out


@nb.njit(**UNCOUNTED)
def _fill(arm, real, imaginary, signs, fold, out):
    """out += the real, then the imaginary rows of arm (F, ny) times a spectrum (F, m); `fold` neighbours in each."""
    F, ny = arm.shape
    for f in range(F):
        for c in range(ny):
            k = f * ny + c
            up, down = k // fold, (F * ny + k) // fold
            a, b = signs[k] * arm[f, c].real, signs[k] * arm[f, c].imag
            p, q = signs[F * ny + k] * arm[f, c].real, signs[F * ny + k] * arm[f, c].imag
            for j in range(real.shape[1]):
                out[up, j] += a * real[f, j] - b * imaginary[f, j]
            for j in range(real.shape[1]):
                out[down, j] += p * imaginary[f, j] + q * real[f, j]
