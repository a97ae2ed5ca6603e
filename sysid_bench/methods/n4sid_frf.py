"""record -> M, D, K by subspace identification on decimated samples and a linear match of its frequency response.

The fair form of the old procedure: the horizon spans a period whatever the sampling time, a free feedthrough
takes up what the hold does within a step, and no matrix logarithm is taken.

Source: Verhaegen, Automatica 30, 1994 (PO-MOESP); the match of the response is our own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid_bench.mechanics.decimation import decimate, decimation_factor
from sysid_bench.mechanics.frf_match import match
from sysid_bench.mechanics.hold_spectra import hold_spectrum
from sysid_bench.mechanics.in_band import MARGIN, band_edge, spectra
from sysid_bench.mechanics.second_order import poles
from sysid_bench.mechanics.subspace import (
    HalfModes,
    InputFit,
    check_sizes,
    default_horizon,
    fit_inputs,
    identify_modes,
)
from sysid_bench.mechanics.suitability import hold_of, require_plain
from sysid_bench.nouns import Array, Estimate, Model, NotApplicable, Record

LOWEST, HIGHEST, LINES = 0.05, 1.15, 120  # of the top mode's frequency; number of frequencies matched
POWER = {"displacement": 0, "velocity": 1, "acceleration": 2}


@dataclass(frozen=True)
class N4sidFrf:
    """PO-MOESP of order 2n on decimated samples, free feedthrough, M, D, K by a linear least-squares match.

    horizon             block rows; null: as n4sid, of decimated samples
    samples_per_period  of the highest mode that the band shows, after decimation; 0: no decimation

    Wants as many independent forces and sensors as degrees of freedom (NotApplicable). Minimises no output
    error; its standard errors are not given.
    """

    horizon: int | None = None
    samples_per_period: float = 8.0

    nominal = False

    def fit(self, record: Record, model: Model) -> Estimate:
        """Estimate with M, D, K, poles; raises NotApplicable or Diverged with the reason."""
        require_plain(record, model, "n4sid_frf")
        n = model.n
        if (
            model.nu != n
            or model.ny != n
            or min(map(np.linalg.matrix_rank, (model.input_map, model.output_map))) < n
        ):
            raise NotApplicable(f"n4sid_frf needs {n} independent forces and sensors.")
        factor = self._factor(record)
        u, y = decimate(record.u, factor), decimate(record.y, factor)
        su, sy = u.std(axis=0), y.std(axis=0)
        if not (np.all(su > 0) and np.all(sy > 0)):
            raise NotApplicable("n4sid_frf wants every input and output to vary; one is constant.")
        i = self.horizon or default_horizon(len(u), n, n, 2 * n)
        check_sizes(len(u), n, n, i, 2 * n)
        z = np.hstack([u / su, y / sy])
        half = identify_modes(z, n, i, 2 * n, "moesp", 2 * n)[0]
        inputs = fit_inputs(half, z[:, :n], z[:, n:], True)
        h = record.h * factor
        top = min(np.abs(np.log(half.p)).max() / h, np.pi / (HIGHEST * h))
        omega = np.linspace(LOWEST * top, HIGHEST * top, LINES)
        G = _response(half, inputs, omega * h) * sy[:, None] / su
        G = G / hold_spectrum(omega, record.h, hold_of(record, model))[:, None, None]
        M, D, K = match(omega, _per_mass(G, omega, model))
        report = {"decimation": factor, "horizon": i, "reflected_poles": half.reflected}
        return Estimate(M, D, K, None, poles(M, D, K), diagnostics=report)

    def _factor(self, record: Record) -> int:
        if not self.samples_per_period:
            return 1
        data = spectra(record.u, record.y, record.h, "zoh")
        top = data.omega[band_edge(data) - 1] / MARGIN
        return decimation_factor(record.h, top, record.N, self.samples_per_period)


def _response(half: HalfModes, inputs: InputFit, angle: Array) -> NDArray[np.complex128]:
    """(F, ny, nu) discrete frequency response at angles omega h."""
    p, c, b = half.full(inputs.beta[:, :-1])
    resolvent = 1 / (np.exp(1j * angle)[:, None] - p)
    assert inputs.feedthrough is not None
    return np.einsum("ik,fk,kj->fij", c, resolvent, b) + inputs.feedthrough


def _per_mass(G: NDArray[np.complex128], omega: Array, model: Model) -> NDArray[np.complex128]:
    """Receptance (F, n, n): maps and output derivative taken out."""
    G = np.linalg.solve(model.output_map, G) @ np.linalg.inv(model.input_map)
    return G / (1j * omega[:, None, None]) ** POWER[model.output]
