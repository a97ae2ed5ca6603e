"""record -> number of degrees of freedom: the last clear gap of the singular values of a subspace step.

With past inputs and outputs as instruments (PO-MOESP) white noise leaves a plateau of equal values behind those of the
modes; a mode weaker than it cannot be told from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.decimation import decimate, decimation_factor
from sysid_bench.mechanics.in_band import MARGIN, band_edge, spectra
from sysid_bench.mechanics.subspace import check_sizes, default_horizon, identify_modes
from sysid_bench.nouns import Array, Diverged, Record

CLEAR = 1.25  # a gap; neighbours on the plateau differ by less
SHARE = 0.4  # power of the widest gap that another one must reach too, where the widest is wide


@dataclass(frozen=True)
class Choice:
    """n: chosen; gaps (largest,): singular value 2k over 2k + 1, for k = 1, 2, ... degrees of freedom."""

    n: int
    gaps: tuple[float, ...]

    @property
    def gap(self) -> float:
        """That of the choice."""
        return self.gaps[self.n - 1]


def number_of_dofs(record: Record, largest: int) -> Choice:
    """At most `largest`. Raises NotApplicable where the record is too short, Diverged where no gap is clear."""
    data = spectra(record.u, record.y, record.h, "zoh")
    factor = decimation_factor(record.h, data.omega[band_edge(data) - 1] / MARGIN, record.N)
    u, y = (decimate(x, factor) for x in (record.u, record.y))
    scale_u, scale_y = (np.maximum(x.std(axis=0), 1e-300) for x in (u, y))
    gaps = _gaps(np.hstack([u / scale_u, y / scale_y]), record.nu, largest)
    clear = np.flatnonzero(gaps > max(CLEAR, gaps.max() ** SHARE))
    if not len(clear):
        raise Diverged("no gap of the singular values is clear: too much noise to tell the order.")
    return Choice(int(clear[-1]) + 1, tuple(gaps))


def _gaps(z: Array, nu: int, largest: int) -> Array:
    N, ny = len(z), z.shape[1] - nu
    i = default_horizon(N, nu, ny, 2 * largest + 1)
    check_sizes(N, nu, ny, i, 2 * largest + 1)
    singular = identify_modes(z, nu, i, 2, "moesp", 2)[1]
    above, below = singular[1 : 2 * largest : 2], singular[2 : 2 * largest + 1 : 2]
    return above / np.maximum(below, np.finfo(float).tiny)
