"""record, structure -> M, D, K by refined instrumental variables in continuous time: no nonlinear optimiser.

Fits the output error only through its fixed point: at rest, the instruments are uncorrelated with it.

Source: Young and Jakeman, Int. J. Control 31, 1980 (SRIVC), in matrix form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.estimation import in_band_run, problem_of
from sysid_bench.mechanics.fisher import inverse_information
from sysid_bench.mechanics.information import information_and_gradient
from sysid_bench.mechanics.likelihood import evaluate
from sysid_bench.mechanics.refined_iv import refine
from sysid_bench.mechanics.second_order import poles, unpack
from sysid_bench.mechanics.start import linear_start
from sysid_bench.mechanics.suitability import hold_of
from sysid_bench.nouns import Diverged, Estimate, Model, NotApplicable, Record


@dataclass(frozen=True)
class MdkSrivc:
    """Matrix SRIVC in the band of the response, s = j omega, symmetric M, D, K, free initial state.

    max_iterations, tolerance   of the linear steps; tolerance: relative change of M, D and K

    Wants a sensor on every degree of freedom and all entries free (NotApplicable). Ignores the images of the
    response beyond Nyquist, which costs up to 1 % of M, D, K at the slowest sampling (h equal to the spacing of
    a spline's knots). Raises Diverged where the steps do not come to rest, as they do not below about 5 dB.
    """

    max_iterations: int = 30
    tolerance: float = 1e-6

    nominal = False

    def fit(self, record: Record, model: Model) -> Estimate:
        """Estimate with covariance; raises NotApplicable or Diverged with the reason."""
        with np.errstate(all="ignore"):
            problem = problem_of([record], model, "diagonal", False, False)
            if not problem.free.all():
                raise NotApplicable("mdk_srivc wants all entries of mass, damping and stiffness free.")
            run = in_band_run(record, problem, hold_of(record, model))
            start = linear_start([run], problem.free, problem.known)
            theta, steps, rest = refine(run.equation, start, self.max_iterations, self.tolerance)
            if not rest:
                raise Diverged(f"refined instrumental variables do not come to rest in {steps} steps.")
            point = evaluate(theta, [run])
            H, _ = information_and_gradient(point, [run])
        M, D, K = unpack(theta, model.n)
        report = {"iterations": steps, "bins": run.F, "log_likelihood": -float(point.cost)}
        return Estimate(M, D, K, inverse_information(H), poles(M, D, K), diagnostics=report)
