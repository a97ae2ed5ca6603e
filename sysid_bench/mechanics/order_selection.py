"""record -> number of degrees of freedom: the order whose simulated output pays for its parameters (BIC)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.decimation import decimate, decimation_factor
from sysid_bench.mechanics.in_band import MARGIN, band_edge, spectra
from sysid_bench.mechanics.subspace import check_sizes, default_horizon, fit_inputs, identify_modes
from sysid_bench.nouns import Array, Diverged, NotApplicable, Record


@dataclass(frozen=True)
class Choice:
    """n: chosen; scores: BIC of n = 1, 2, ... (nan: no model)."""

    n: int
    scores: tuple[float, ...]


def number_of_dofs(record: Record, largest: int) -> Choice:
    """Subspace models of order 2, 4, ..., 2 `largest` on decimated samples, each with its best input and start.

    Raises NotApplicable where the record is too short for any, Diverged where none can be fitted.
    """
    data = spectra(record.u, record.y, record.h, "zoh")
    factor = decimation_factor(record.h, data.omega[band_edge(data) - 1] / MARGIN, record.N)
    u, y = (decimate(x, factor) for x in (record.u, record.y))
    z = np.hstack([u / u.std(axis=0), y / y.std(axis=0)])
    scores = [_score(z, record.nu, 2 * n) for n in range(1, largest + 1)]
    if np.all(np.isnan(scores)):
        raise Diverged("no order gives a model of this record.")
    return Choice(int(np.nanargmin(scores)) + 1, tuple(scores))


def _score(z: Array, nu: int, nx: int) -> float:
    N, ny = len(z), z.shape[1] - nu
    i = default_horizon(N, nu, ny, nx)
    try:
        check_sizes(N, nu, ny, i, nx)
        modes, _ = identify_modes(z, nu, i, nx, "moesp", nx)
        residual = fit_inputs(modes, z[:, :nu], z[:, nu:], True).residual
    except (NotApplicable, Diverged, np.linalg.LinAlgError):
        return float("nan")
    free = nx * (nu + ny + 1) + nu * ny
    return float(N * np.log(np.mean(residual**2, axis=0)).sum() + free * np.log(N * ny))
