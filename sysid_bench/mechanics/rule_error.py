"""record, model, integration rule -> the output error of that rule as a point of a Levenberg-Marquardt search."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.holds import propagate
from sysid_bench.mechanics.levenberg import Point
from sysid_bench.mechanics.modal import sensitivity
from sysid_bench.mechanics.second_order import state_space, unpack
from sysid_bench.nouns import Array, Model, Record

CLEAN = 1e-18  # of the output's variance: where a search on data without noise ends


@dataclass(frozen=True, eq=False)
class RuleError:
    """evaluate(p) of p = (theta, q and q' at the first sample), all free, for a rule of mechanics.rules."""

    record: Record
    model: Model
    rule: str

    def __call__(self, p: Array) -> Point:
        model, n = self.model, self.model.n
        nowhere = Point(p, np.full(self.record.ny, np.inf), np.full((1, 1), np.nan), p)
        try:
            found = sensitivity(
                *unpack(p[: -2 * n], n), model.input_map, model.output_map, model.output,
                self.record.u, self.record.h, self.rule, p[-2 * n :],
            )  # fmt: skip
        except (np.linalg.LinAlgError, ValueError):
            return nowhere
        residual = self.record.y - found.y
        variance = np.maximum(np.mean(residual**2, axis=0), CLEAN * self.record.y.var(axis=0))
        if not np.all(np.isfinite(variance)):
            return nowhere
        return Point(p, variance, *found.normal(residual, 1 / variance), found)

    def bias(self, point: Point, inverse: Array, hold: str) -> Array:
        """(np,) by how far the search moves, to first order, from the p that gives its exact response under `hold`.

        inverse (np, np): of the information at the minimum.
        """
        model, n, record = self.model, self.model.n, self.record
        A, B, C, D = state_space(
            *unpack(point.p[: -2 * n], n), model.input_map, model.output_map, model.output
        )
        x = propagate(A, B, record.u, record.h, hold, point.p[-2 * n :], record.period)
        distance = x @ C.T + record.u @ D.T - point.prediction.y
        return inverse @ point.prediction.normal(distance, 1 / point.variance)[1]
