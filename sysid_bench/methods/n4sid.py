"""record -> M, D, K by subspace identification, d2c and a projection: the state of the art that Bruschetta compares with.

Source: Van Overschee and De Moor, Subspace Identification for Linear Systems, 1996, chapter 4; Verhaegen,
Automatica 30, 1994.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid_bench.mechanics import jackknife
from sysid_bench.mechanics.bias import bias_remarks
from sysid_bench.mechanics.projection import PROJECTIONS, project
from sysid_bench.mechanics.second_order import pack
from sysid_bench.mechanics.subspace import WEIGHTS
from sysid_bench.mechanics.subspace_model import SubspaceModel, identify
from sysid_bench.mechanics.suitability import hold_of, require_plain
from sysid_bench.nouns import Array, Diverged, Estimate, InputError, Model, Record

HOLD_CHOICES = ("zoh", "record")
HEALTHY_HORIZON = 0.3  # of the shortest period: measured, docs/methods/subspace.md


@dataclass(frozen=True)
class N4sid:
    """Subspace identification of order 2n, discrete to continuous by the logarithm, projection on M, D, K.

    order        "model" (2n), "gap" (before the widest gap of the singular values) or a number
    horizon      block rows of the past and of the future; None: 20 for up to 3 outputs, 12 from 5 on
    horizon_s    the same in s, takes precedence. Healthy from about 0.4 of the shortest modal period
    weight       moesp | cva
    feedthrough  estimate a direct term too (always for accelerations)
    hold         of the conversion: zoh, as the thesis does whatever the input is; record: the record's own
    projection   direct | modal
    blocks       of the jackknife for the standard errors; 0: none

    bias_in_interval   behind another hold than the record's, add the square of what the right one would change

    Minimises the output error over B, x0 only. The standard errors (block jackknife) count variance and, with
    bias_in_interval, the O(h) bias of the wrong hold. They do not count the bias of a horizon far below the
    shortest period, nor of noise in the modes where the error is large: there they are too small.
    """

    order: int | str = "model"
    horizon: int | None = None
    horizon_s: float | None = None
    weight: str = "moesp"
    feedthrough: bool = False
    hold: str = "zoh"
    projection: str = "direct"
    blocks: int = 24
    bias_in_interval: bool = True

    nominal = False

    def __post_init__(self) -> None:
        choices = {"weight": WEIGHTS, "hold": HOLD_CHOICES, "projection": PROJECTIONS}
        for name, allowed in choices.items():
            if getattr(self, name) not in allowed:
                raise InputError(
                    f"{name} of n4sid must be one of {', '.join(allowed)}; got {getattr(self, name)!r}."
                )
        if not (self.order in ("model", "gap") or (isinstance(self.order, int) and self.order > 0)):
            raise InputError(f"order of n4sid must be model, gap or a positive number; got {self.order!r}.")

    def fit(self, record: Record, model: Model) -> Estimate:
        """Estimate with M, D, K, poles, state space; raises NotApplicable or Diverged with the reason."""
        require_plain(record, model, "n4sid")
        nx = self.order if isinstance(self.order, int) else 2 * model.n if self.order == "model" else None
        direct = self.feedthrough or model.output == "acceleration"
        found = identify(
            record, self._horizon(record, nx or 2 * model.n), nx, 4 * model.n, self.weight, direct
        )
        actual = hold_of(record, model)
        if self.hold == "record" and actual != "zoh":
            found = found.behind(actual)
        poles, space = found.continuous_form()[0], found.state_space()
        if found.order != 2 * model.n:
            reason = f"no M, D, K: the order is {found.order}, not {2 * model.n}."
            return Estimate(poles=poles, state_space=space, reason=reason, diagnostics=_report(found))
        M, D, K = project(found.continuous_form(), model, self.projection)
        covariance, remarks = self._covariance(found, model, actual)
        report = _report(found) | _said(remarks, _horizon_warning(found, poles, record.h))
        return Estimate(M, D, K, covariance, poles, space, diagnostics=report)

    def _horizon(self, record: Record, nx: int) -> int | None:
        if self.horizon_s is None:
            return self.horizon
        return max(round(self.horizon_s / record.h), -(-nx // record.ny) + 1)

    def _covariance(
        self, found: SubspaceModel, model: Model, actual: str
    ) -> tuple[Array | None, dict[str, Any]]:
        """Of theta, and diagnostics on the bias of the hold."""

        def theta(of: SubspaceModel, *replicate) -> Array:
            return pack(*project(of.continuous_form(*replicate), model, self.projection))

        def or_none(replicate) -> Array | None:
            try:
                return None if replicate is None else theta(found, *replicate)
            except Diverged:
                return None

        if not self.blocks:
            return None, {}
        covariance = jackknife.covariance([or_none(one) for one in found.without_blocks(self.blocks)])
        if covariance is None or found.hold == actual:
            return covariance, {}
        bias = theta(found) - theta(found.behind(actual))
        what = f"the bias of a {found.hold} conversion of a record behind {actual}"
        remarks = bias_remarks(bias, covariance, "hold_bias_over_std", what, self.bias_in_interval)
        return covariance + (np.outer(bias, bias) if self.bias_in_interval else 0.0), remarks


def _horizon_warning(found: SubspaceModel, poles: np.ndarray, h: float) -> str:
    shortest = 2 * np.pi / max(np.abs(poles).max(initial=0.0), np.finfo(float).tiny)
    if found.i * h >= HEALTHY_HORIZON * shortest:
        return ""
    return (
        f"the horizon of {found.i * h:.3g} s is short beside the shortest period, {shortest:.3g} s: the intervals do not "
        "count what that does; set horizon_s, or method=n4sid_frf or spline_ml"
    )


def _said(remarks: dict[str, Any], more: str) -> dict[str, Any]:
    both = [text for text in (remarks.get("warning", ""), more) if text]
    return remarks | ({"warning": "; ".join(both)} if both else {})


def _report(found: SubspaceModel) -> dict[str, float]:
    s, nx = found.singular_values, found.order
    return {
        "order": nx,
        "horizon": found.i,
        "reflected_poles": found.modes.reflected,
        "singular_value_gap": float(s[nx - 1] / s[nx]) if s[nx] > 0 else float("inf"),
        "relative_residual": float(np.sqrt(np.mean(found.inputs.residual**2))),
    }
