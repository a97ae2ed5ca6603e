"""record -> M, D, K by subspace identification, d2c and a projection: the state of the art that Bruschetta compares with."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sysid_bench.mechanics import jackknife
from sysid_bench.mechanics.conversion import Modes, continuous_poles, d2c
from sysid_bench.mechanics.projection import PROJECTIONS, project
from sysid_bench.mechanics.second_order import pack
from sysid_bench.mechanics.subspace import (
    WEIGHTS,
    HalfModes,
    InputFit,
    check_sizes,
    default_horizon,
    fit_inputs,
    hold_drives,
    identify_modes,
    real_state_space,
)
from sysid_bench.mechanics.subspace_jackknife import replicates
from sysid_bench.mechanics.suitability import hold_of, require_plain
from sysid_bench.nouns import Array, Diverged, Estimate, InputError, Model, NotApplicable, Record

HOLD_CHOICES = ("zoh", "record")


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

    Minimises the output error over B, x0 only. The standard errors count variance: they cover the truth where
    the hold is right and the horizon long enough. A smooth input behind hold=zoh biases M, D and K by O(h),
    and a horizon far below the shortest period biases the poles; then they are too small.
    """

    order: int | str = "model"
    horizon: int | None = None
    horizon_s: float | None = None
    weight: str = "moesp"
    feedthrough: bool = False
    hold: str = "zoh"
    projection: str = "direct"
    blocks: int = 24

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
        hold = hold_of(record, model) if self.hold == "record" else "zoh"
        feedthrough = self.feedthrough or model.output == "acceleration"
        nx = {"model": 2 * model.n, "gap": None}.get(self.order, self.order)
        i = self._horizon(record, nx or 2 * model.n)
        su, sy = record.u.std(axis=0), record.y.std(axis=0)
        if not (np.all(su > 0) and np.all(sy > 0)):
            raise NotApplicable("n4sid wants every input and output to vary; one is constant.")
        z = np.hstack([record.u / su, record.y / sy])
        modes, s = identify_modes(z, record.nu, i, nx, self.weight, 4 * model.n)
        scaled = _Scaled(su, sy, record.h, hold)
        drives = None if hold == "zoh" else hold_drives(modes, z[:, : record.nu], record.h, hold)
        inputs = fit_inputs(modes, z[:, : record.nu], z[:, record.nu :], feedthrough, drives)
        report = self._report(modes, inputs, s, i)
        return self._estimate(model, modes, inputs, scaled, report, z, i)

    def _horizon(self, record: Record, nx: int) -> int:
        i = self.horizon or default_horizon(record.N, record.nu, record.ny, nx)
        if self.horizon_s is not None:
            i = max(round(self.horizon_s / record.h), -(-nx // record.ny) + 1)
        check_sizes(record.N, record.nu, record.ny, i, nx)
        return i

    def _report(self, modes: HalfModes, inputs: InputFit, s: Array, i: int) -> dict[str, float]:
        nx = int(modes.weight.sum())
        return {
            "order": nx,
            "horizon": i,
            "reflected_poles": modes.reflected,
            "singular_value_gap": float(s[nx - 1] / s[nx]) if s[nx] > 0 else float("inf"),
            "relative_residual": float(np.sqrt(np.mean(inputs.residual**2))),
        }

    def _estimate(
        self,
        model: Model,
        modes: HalfModes,
        inputs: InputFit,
        scaled: _Scaled,
        report: dict,
        z: Array,
        i: int,
    ) -> Estimate:
        form = scaled.continuous(modes, inputs.beta)
        space = scaled.state_space(modes, inputs)
        if len(form[0]) != 2 * model.n:
            reason = f"no M, D, K: the order is {len(form[0])}, not {2 * model.n}."
            return Estimate(poles=form[0], state_space=space, reason=reason, diagnostics=report)
        M, D, K = project(form, model, self.projection)
        covariance = self._covariance(model, modes, inputs, scaled, z, i)
        return Estimate(M, D, K, covariance, form[0], space, diagnostics=report)

    def _covariance(
        self, model: Model, modes: HalfModes, inputs: InputFit, scaled: _Scaled, z: Array, i: int
    ) -> Array | None:
        if not self.blocks:
            return None
        found = replicates(z, model.nu, i, self.weight, modes, inputs, self.blocks)
        try:
            thetas = [pack(*project(scaled.continuous(*one), model, self.projection)) for one in found]
        except Diverged:
            return None
        return jackknife.covariance(np.array(thetas)) if thetas else None


@dataclass(frozen=True, eq=False)
class _Scaled:
    """Undoes the scaling of the channels, and the sampling."""

    su: Array
    sy: Array
    h: float
    hold: str

    def continuous(self, modes: HalfModes, beta: np.ndarray) -> Modes:
        """Behind a zoh beta is discrete, else already continuous."""
        p, c, rows = modes.full(beta[:, :-1] / self.su)
        c = c * self.sy[:, None]
        if self.hold == "zoh":
            lam, rows = d2c(p, rows, self.h)
            return lam, c, rows
        return continuous_poles(p, self.h), c, rows

    def state_space(self, modes: HalfModes, inputs: InputFit) -> tuple[Array, Array, Array, Array, float]:
        """Discrete behind a zoh; else continuous, h = 0, as no discrete one has the same input."""
        zoh = self.hold == "zoh"
        poles = modes.p if zoh else continuous_poles(modes.p, self.h)
        A, B, C = real_state_space(replace(modes, p=poles), inputs.beta[:, :-1])
        D = np.zeros((len(C), B.shape[1])) if inputs.feedthrough is None else inputs.feedthrough
        return A, B / self.su, C * self.sy[:, None], D * self.sy[:, None] / self.su, self.h if zoh else 0.0
