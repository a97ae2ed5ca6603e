"""spectra of forces at one place -> the screen's rows: filtered by the plant, whitened and thinned in one pass."""

from __future__ import annotations

import numba as nb
import numpy as np

from sysid_bench.gap.basis import sketch
from sysid_bench.gap.motion import Seen
from sysid_bench.mechanics.compiled import UNCOUNTED
from sysid_bench.nouns import Array


def place_rows(seens: list[Seen], c: Array, spectra: list[list[np.ndarray]], more: int = 0) -> Array:
    """(rows + more, m) thinned rows, as basis.stack makes them of columns.force_columns, then rows of zeros.

    spectra: per trace blocks (m_i, F), m in all, of the forces
    """
    arms = [-(s.G[:, :, : len(c)] @ c) * s.trace.weight for s in seens]
    sketches = [sketch(2 * arm.size) for arm in arms]
    ends = np.cumsum([0, *(-(-2 * arm.size // fold) for arm, (fold, _) in zip(arms, sketches))])
    out = np.zeros((ends[-1] + more, sum(len(block) for block in spectra[0])))
    for arm, (fold, signs), blocks, row in zip(arms, sketches, spectra, ends):
        column = 0
        for block in blocks:
            _fill(arm, np.ascontiguousarray(block), np.empty((2, len(block))), signs, fold, out, row, column)
            column += len(block)
    return out


@nb.njit(**UNCOUNTED)
def _fill(arm, X, bin_, signs, fold, out, row, column):
    """out[row:, column:] += the real, then the imaginary rows of arm (F, ny) times spectra X (m, F); `fold` neighbours in each; bin_ (2, m): room."""
    F, ny = arm.shape
    m, real, imaginary = len(X), bin_[0], bin_[1]
    for f in range(F):
        for j in range(m):
            real[j], imaginary[j] = X[j, f].real, X[j, f].imag
        for c in range(ny):
            k = f * ny + c
            up, down = row + k // fold, row + (F * ny + k) // fold
            a, b = signs[k] * arm[f, c].real, signs[k] * arm[f, c].imag
            p, q = signs[F * ny + k] * arm[f, c].real, signs[F * ny + k] * arm[f, c].imag
            for j in range(m):
                out[up, column + j] += a * real[j] - b * imaginary[j]
            for j in range(m):
                out[down, column + j] += p * imaginary[j] + q * real[j]
