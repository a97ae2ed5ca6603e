"""record -> M, D, K by output-error minimisation of the two-stage Gauss variational integrator: order 4.

The thesis' open problem of higher-order schemes (Bruschetta 2011, chapter 7): collocation on the Gauss points is
the variational integrator of the two-stage Galerkin action (Ober-Bloebaum and Saake, Adv. Comput. Math. 41, 2015).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.bias import bias_remarks
from sysid_bench.mechanics.estimation import in_band_run, problem_of
from sysid_bench.mechanics.fisher import inverse_information
from sysid_bench.mechanics.levenberg import Minimum, minimise
from sysid_bench.mechanics.rule_error import RuleError
from sysid_bench.mechanics.second_order import ntheta, pack, poles, unpack
from sysid_bench.mechanics.start import linear_start, refined_start
from sysid_bench.mechanics.suitability import hold_of, require_plain
from sysid_bench.nouns import Array, Diverged, Estimate, InputError, Model, NotApplicable, Record


@dataclass(frozen=True)
class VariationalGauss2:
    """Poles are the diagonal Pade(2,2) approximation of exp(h lam); the force is the spline at the Gauss points.

    start            linear: least squares in the band; nominal: the model's values
    max_iterations, tolerance   of the search; the tolerance is a decrement of the log-likelihood

    bias_in_interval add the squared bias to the covariance, estimated as what the same search would do to the exact
                     response of the estimate

    Bias of order h^4 (midpoint: h^2) behind a smooth force. Raises Diverged where the search does not end in a minimum.
    """

    start: str = "linear"
    max_iterations: int = 40
    tolerance: float = 1e-3
    bias_in_interval: bool = True

    @property
    def nominal(self) -> bool:
        return self.start == "nominal"

    def __post_init__(self) -> None:
        if self.start not in ("linear", "nominal"):
            raise InputError(f"start of variational_gauss2 must be linear or nominal; got {self.start!r}.")

    def fit(self, record: Record, model: Model) -> Estimate:
        """Estimate with covariance; raises NotApplicable or Diverged with the reason."""
        require_plain(record, model, "variational_gauss2")
        with np.errstate(all="ignore"):
            p = np.concatenate([self._start(record, model), np.zeros(2 * model.n)])
            search = RuleError(record, model, "gauss2")
            found = minimise(search, p, self.max_iterations, self.tolerance)
        return self._estimate(search, found)

    def _estimate(self, search: RuleError, found: Minimum) -> Estimate:
        record, model = search.record, search.model
        count = ntheta(model.n)
        M, D, K = unpack(found.point.p[:count], model.n)
        try:
            inverse = inverse_information(found.point.hessian)
        except np.linalg.LinAlgError as problem:
            raise Diverged(f"the minimum is flat: {problem}.") from None
        bias = search.bias(found.point, inverse, hold_of(record, model))[:count]
        covariance = inverse[:count, :count]
        report = {
            "iterations": found.iterations,
            "relative_residual": float(np.sqrt(np.mean(found.point.variance / record.y.var(axis=0)))),
            **bias_remarks(
                bias, covariance, "gauss2_bias_over_std", f"the bias of the Gauss rule at h = {record.h:g} s",
                self.bias_in_interval,
            ),
        }  # fmt: skip
        if self.bias_in_interval:
            covariance = covariance + np.outer(bias, bias)
        return Estimate(M, D, K, covariance, poles(M, D, K), diagnostics=report)

    def _start(self, record: Record, model: Model) -> Array:
        if self.start == "nominal":
            if model.mass is None or model.damping is None or model.stiffness is None:
                raise NotApplicable("start=nominal wants a model with values of mass, damping and stiffness.")
            return pack(*model.matrices)
        problem = problem_of([record], model, "diagonal", False, False)
        run = in_band_run(record, problem, "cubic")
        everything = np.ones_like(problem.free)
        return refined_start([run], everything, linear_start([run], everything, problem.known)).theta
