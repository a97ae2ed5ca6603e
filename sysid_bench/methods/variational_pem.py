"""record -> M, D, K by output-error minimisation of the midpoint variational integrator (Bruschetta 2011, chapter 4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.bias import bias_remarks
from sysid_bench.mechanics.cayley import midpoint_start
from sysid_bench.mechanics.fisher import inverse_information
from sysid_bench.mechanics.holds import propagate
from sysid_bench.mechanics.levenberg import Minimum, Point, minimise
from sysid_bench.mechanics.modal import Sensitivity, sensitivity
from sysid_bench.mechanics.second_order import free_mask, ntheta, pack, poles, state_space, unpack
from sysid_bench.mechanics.subspace_model import identify
from sysid_bench.mechanics.suitability import hold_of, require_plain
from sysid_bench.nouns import Array, Diverged, Estimate, InputError, Model, NotApplicable, Record

CHOICES = {"start": ("n4sid", "nominal"), "force": ("record", "average")}


@dataclass(frozen=True)
class VariationalPem:
    """Minimises the output error of M_d q(k) + D_d q(k-1) + K_d q(k-2) = f_d(k) over symmetric M, D, K.

    In modal form: midpoint poles (1 + h lam/2) / (1 - h lam/2), analytic sensitivities, free initial state,
    Levenberg-Marquardt on the sum of log residual variances; (2.26) is a bijection that keeps symmetry, so the
    minimum is that of (4.16)-(4.18).

    start            n4sid: (4.15) with the missing 1/h; nominal: the model's values
    horizon          block rows of the n4sid start; None: as in n4sid
    force            record: the midpoint of each step behind a zero-order hold is u(k), else the mean of u(k) and
                     u(k+1), as in (2.24); average: (2.24) whatever the hold is
    max_iterations, tolerance   of the search; the tolerance is a decrement of the log-likelihood
    bias_in_interval add the squared O(h^2) bias to the covariance, estimated as what the same search would do to
                     the exact response of the estimate

    Raises Diverged where the search ends elsewhere than in a minimum with positive definite M and K.
    """

    start: str = "n4sid"
    horizon: int | None = None
    force: str = "record"
    max_iterations: int = 40
    tolerance: float = 1e-3
    bias_in_interval: bool = True

    @property
    def nominal(self) -> bool:
        return self.start == "nominal"

    def __post_init__(self) -> None:
        for name, allowed in CHOICES.items():
            if getattr(self, name) not in allowed:
                raise InputError(
                    f"{name} of variational_pem must be one of {', '.join(allowed)}; got {getattr(self, name)!r}."
                )

    def fit(self, record: Record, model: Model) -> Estimate:
        """Estimate with covariance; raises NotApplicable or Diverged with the reason."""
        require_plain(record, model, "variational_pem")
        if not np.all(record.y.std(axis=0) > 0):
            raise NotApplicable("variational_pem wants every output to vary; one is constant.")
        hold = hold_of(record, model)
        rule = "cayley_zoh" if hold == "zoh" and self.force == "record" else "cayley"
        search = _Search(record, model, rule, _live(model))
        theta = pack(*self._start(record, model))
        fixed = ~free_mask(model)
        if fixed.any():
            theta[fixed] = pack(*model.matrices)[fixed]
        p = np.concatenate([theta, np.zeros(2 * model.n)])
        found = minimise(search.on(p), p[search.live], self.max_iterations, self.tolerance)
        p[search.live] = found.point.p
        return self._estimate(search, found, p, hold)

    def _start(self, record: Record, model: Model) -> tuple[Array, Array, Array]:
        if self.start == "nominal":
            if not model.has_values:
                raise NotApplicable("start=nominal wants a model with values of mass, damping and stiffness.")
            return model.matrices
        found = identify(record, self.horizon, 2 * model.n, 2 * model.n)
        return midpoint_start(found.discrete_form(), model, record.h)

    def _estimate(self, search: _Search, found: Minimum, p: Array, hold: str) -> Estimate:
        count, n = ntheta(search.model.n), search.model.n
        M, D, K = unpack(p[:count], n)
        if min(np.linalg.eigvalsh(M)[0], np.linalg.eigvalsh(K)[0]) <= 0:
            raise Diverged("the search ended in a minimum whose mass or stiffness is not positive definite.")
        try:
            inverse = inverse_information(found.point.hessian)
        except np.linalg.LinAlgError as problem:
            raise Diverged(f"the minimum is flat: {problem}.") from None
        bias = inverse @ search.distortion(p, hold, found.point)
        of_theta = np.flatnonzero(search.live) < count
        report = {
            "iterations": found.iterations,
            "relative_residual": float(np.sqrt(np.mean(found.point.variance / search.record.y.var(axis=0)))),
            **bias_remarks(
                bias[of_theta], inverse[np.ix_(of_theta, of_theta)], "midpoint_bias_over_std",
                f"the bias of the midpoint rule at h = {search.record.h:g} s", self.bias_in_interval,
            ),
        }  # fmt: skip
        full = np.zeros((len(p), len(p)))
        full[np.ix_(search.live, search.live)] = inverse + (
            np.outer(bias, bias) if self.bias_in_interval else 0.0
        )
        return Estimate(M, D, K, full[:count, :count], poles(M, D, K), diagnostics=report)


def _live(model: Model) -> np.ndarray:
    """(ntheta + 2n,) which of theta and [q, q'] at the first sample are unknown; at rest: q' is zero."""
    moving = np.full(model.n, model.initial_state == "free")
    return np.concatenate([free_mask(model), np.ones(model.n, dtype=bool), moving])


@dataclass(frozen=True, eq=False)
class _Search:
    """The output error of p = (theta, initial state) under a midpoint rule."""

    record: Record
    model: Model
    rule: str
    live: np.ndarray

    def on(self, p: Array):
        """evaluate(live entries) -> Point, the other entries as in p."""

        def evaluate(values: Array) -> Point:
            trial = p.copy()
            trial[self.live] = values
            return self._point(trial, values)

        return evaluate

    def _point(self, p: Array, values: Array) -> Point:
        nowhere = Point(values, np.full(self.record.ny, np.inf), np.full((1, 1), np.nan), values)
        try:
            found = self._sensitivity(p)
        except (np.linalg.LinAlgError, ValueError):
            return nowhere
        residual = self.record.y - found.y
        variance = np.mean(residual**2, axis=0)
        if not np.all(np.isfinite(variance)):
            return nowhere
        # The floor ends the search on data without noise before it chases rounding.
        variance = np.maximum(variance, 1e-18 * self.record.y.var(axis=0))
        hessian, gradient = found.normal(residual, 1 / variance)
        return Point(values, variance, hessian[np.ix_(self.live, self.live)], gradient[self.live], found)

    def _sensitivity(self, p: Array) -> Sensitivity:
        model, n = self.model, self.model.n
        M, D, K = unpack(p[: -2 * n], n)
        maps = model.input_map, model.output_map, model.output
        return sensitivity(M, D, K, *maps, self.record.u, self.record.h, self.rule, p[-2 * n :])

    def distortion(self, p: Array, hold: str, point: Point) -> Array:
        """J' W (exact response - midpoint response) of the model p; the record's hold makes the exact one."""
        model, n, record = self.model, self.model.n, self.record
        A, B, C, D = state_space(*unpack(p[: -2 * n], n), model.input_map, model.output_map, model.output)
        x = propagate(A, B, record.u, record.h, hold, p[-2 * n :], record.period)
        distance = x @ C.T + record.u @ D.T - point.prediction.y
        _, gradient = point.prediction.normal(distance, 1 / point.variance)
        return gradient[self.live]
