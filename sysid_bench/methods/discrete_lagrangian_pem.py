"""record, Lagrangian -> its parameters by output-error minimisation of the forced discrete Euler-Lagrange equations.

Source: Marsden and West, Acta Numerica 10, 2001, 2.7 and 3.2; Ober-Blöbaum and Saake, Adv. Comput. Math. 41, 2015.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sysid_bench.mechanics.fisher import inverse_information
from sysid_bench.mechanics.lagrangian import Stepper, sensitivities, stage_inputs, stepper, trajectory
from sysid_bench.mechanics.levenberg import Point, minimise
from sysid_bench.mechanics.suitability import hold_of, require_channels
from sysid_bench.nouns import Array, Diverged, Estimate, InputError, Model, NotApplicable, Record


@dataclass(frozen=True)
class DiscreteLagrangianPem:
    """Free parameters of `system` and the initial state (angles from the first samples, rates free).

    system          a Lagrangian system (group lagrangian); its values are the start, and stay where not free
    free            names of the parameters to estimate; [] all
    scheme          gauss2 (order 4) | midpoint (order 2)
    max_iterations, tolerance   of the search; the tolerance is a decrement of the log-likelihood

    Minimises the sum over outputs of log residual variance; sensitivities exact for the scheme. The parameters and
    their standard errors are in Estimate.coefficients (NAME, NAME_std). Flagged samples are left out. Raises
    Diverged where the search ends elsewhere than in a minimum.
    """

    system: Any
    free: list[str] = field(default_factory=lambda: ["length_m", "damping_N_m_s"])
    scheme: str = "gauss2"
    max_iterations: int = 60
    tolerance: float = 1e-3

    nominal = False

    def fit(self, record: Record, model: Model) -> Estimate:
        """Estimate with coefficients; the model says which coordinates are measured (output_map)."""
        require_channels(record, model)
        if model.n != self.system.n or model.nu != self.system.nu or model.output != "displacement":
            raise NotApplicable(
                f"the Lagrangian has {self.system.n} coordinates and {self.system.nu} inputs, measured as displacements."
            )
        search = _Search(self, record, model, self._made(record))
        found = minimise(search, search.start(), self.max_iterations, self.tolerance)
        try:
            covariance = inverse_information(found.point.hessian)
        except np.linalg.LinAlgError as problem:
            raise Diverged(f"the record does not tell all of {', '.join(search.names)}: {problem}.") from None
        deviation = np.sqrt(np.diag(covariance))
        coefficients = {name: float(found.point.p[k]) for k, name in enumerate(search.names)}
        coefficients |= {f"{name}_std": float(deviation[k]) for k, name in enumerate(search.names)}
        residual = float(np.sqrt(np.mean(found.point.variance / record.y[search.good].var(axis=0))))
        report = {"iterations": found.iterations, "relative_residual": residual}
        return Estimate(coefficients=coefficients, diagnostics=report)

    def _made(self, record: Record) -> Stepper:
        unknown = sorted(set(self.free) - set(self.system.values()))
        if unknown:
            raise InputError(
                f"free names {', '.join(unknown)}; the system has {', '.join(self.system.values())}."
            )
        return stepper(self.system, self.scheme, record.h)


@dataclass(frozen=True, eq=False)
class _Search:
    """evaluate(p) of p = (free parameters, q and v at the first sample)."""

    method: DiscreteLagrangianPem
    record: Record
    model: Model
    made: Stepper

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(name for name in self.made.names if name in self.method.free or not self.method.free)

    @property
    def good(self) -> Array:
        quality = self.record.quality
        return np.ones(self.record.N, dtype=bool) if quality is None else quality == 0

    def start(self) -> Array:
        values = self.method.system.values()
        k = np.flatnonzero(self.good)[:2]
        q = np.linalg.lstsq(self.model.output_map, self.record.y[k].T, rcond=None)[0].T
        v = (q[1] - q[0]) / (self.record.t[k[1]] - self.record.t[k[0]])
        return np.concatenate([[values[name] for name in self.names], q[0], v])

    def __call__(self, p: Array) -> Point:
        values, count = dict(self.method.system.values()), len(self.names)
        values.update(zip(self.names, p[:count]))
        theta = np.array([values[name] for name in self.made.names])
        stages = stage_inputs(self.record.u, hold_of(self.record, self.model), self.made.points)
        nowhere = Point(p, np.full(self.record.ny, np.inf), np.full((1, 1), np.nan), p)
        try:
            x = trajectory(self.made, theta, p[count:], stages)
        except Diverged:
            return nowhere
        S = sensitivities(self.made, theta, x, stages)
        live = [self.made.names.index(name) for name in self.names] + list(range(len(theta), S.shape[2]))
        n, good = self.model.n, self.good
        J = np.einsum("yq,kqp->kyp", self.model.output_map, S[:, :n, live])[good]
        residual = (self.record.y - x[:, :n] @ self.model.output_map.T)[good]
        variance = np.maximum(np.mean(residual**2, axis=0), 1e-18 * self.record.y[good].var(axis=0))
        hessian = np.einsum("kyp,y,kyq->pq", J, 1 / variance, J, optimize=True)
        gradient = np.einsum("kyp,y,ky->p", J, 1 / variance, residual, optimize=True)
        return Point(p, variance, hessian, gradient, x)
