"""record -> difference-equation coefficients by least squares, and the M, D, K they imply (Kapucu and Baysec 1997)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid_bench.mechanics import jackknife
from sysid_bench.mechanics.bias import bias_remarks
from sysid_bench.mechanics.difference import (
    DifferenceEquation,
    Orders,
    from_theta,
    least_squares,
    modal_form,
)
from sysid_bench.mechanics.instruments import instruments
from sysid_bench.mechanics.projection import PROJECTIONS, project
from sysid_bench.mechanics.second_order import pack, sort_poles
from sysid_bench.mechanics.suitability import hold_of, require_plain
from sysid_bench.nouns import Array, Diverged, Estimate, InputError, Model, NotApplicable, Record

RECOVERIES = ("instruments", "least_squares")


@dataclass(frozen=True)
class Arx:
    """y(k) + a1 y(k-1) + ... = b0 u(k) + b1 u(k-1) + ...: matrices of coefficients for several channels.

    na, nb, nk   output lags, input lags, first input lag; 2, 3, 0 is the paper's equation, b0 free
    recover      what M, D, K and the poles come from.
                 instruments: the same equation estimated by refined instrumental variables, which white noise
                 on the output does not bias; least_squares: the coefficients themselves, as in the paper
    hold         of the conversion: record (the record's own) or zoh
    projection   direct | modal, as in n4sid
    rounds       of the instrumental variables, at most
    blocks       of the jackknife for the standard errors; 0: none

    `coefficients` are always those of least squares (eq. (12), corrected), which minimise the equation error:
    consistent for white equation noise only. White noise on the output biases them, towards worse as h falls.
    The standard errors of M, D, K cover the truth with recover=instruments, where the record is long enough
    for its normal approximation; with recover=least_squares only if the equation noise is white. An equation of
    these orders is exact behind zoh and foh, and close behind cubic while the force is smooth at the scale of h.
    """

    na: int = 2
    nb: int = 3
    nk: int = 0
    recover: str = "instruments"
    hold: str = "record"
    projection: str = "direct"
    rounds: int = 10
    blocks: int = 30

    nominal = False

    def __post_init__(self) -> None:
        choices = {"recover": RECOVERIES, "hold": ("record", "zoh"), "projection": PROJECTIONS}
        for name, allowed in choices.items():
            if getattr(self, name) not in allowed:
                raise InputError(
                    f"{name} of arx must be one of {', '.join(allowed)}; got {getattr(self, name)!r}."
                )
        if self.na < 1 or self.nb < 1 or self.nk < 0 or self.rounds < 1:
            raise InputError(
                "arx wants na >= 1, nb >= 1, nk >= 0, rounds >= 1; "
                f"got {self.na}, {self.nb}, {self.nk}, {self.rounds}."
            )

    def fit(self, record: Record, model: Model) -> Estimate:
        """Coefficients always; M, D, K, poles and covariance where they can be recovered, else `reason` says why.

        Raises NotApplicable for uneven, flagged or too short records.
        """
        require_plain(record, model, "arx")
        orders = Orders(self.na, self.nb, self.nk)
        unknowns = self.na * record.ny + self.nb * record.nu
        if record.N - orders.start < unknowns:
            raise NotApplicable(
                f"{record.N} samples are too few: arx wants {unknowns + orders.start} for {unknowns} coefficients."
            )
        parts = jackknife.blocks(record.N - orders.start, self.blocks, 2 * (orders.start + 1))
        theta, influences, error = least_squares(record.u, record.y, orders, parts)
        equation = from_theta(theta, record.ny, record.nu, orders)
        report = {"equation_error": error}
        try:
            if self.recover == "instruments":
                data = record.u, record.y, orders, equation, self.rounds, parts
                theta, influences = instruments(*data)
            estimate = self._recovered(record, model, orders, theta, influences)
            if self.recover == "least_squares":
                report |= self._noise_bias(record, model, orders, equation, theta, estimate.covariance)
        except (Diverged, NotApplicable) as problem:
            estimate = Estimate(reason=f"no M, D, K: {problem}")
        return replace(estimate, coefficients=equation.named(), diagnostics=report)

    def _recovered(
        self, record: Record, model: Model, orders: Orders, theta: Array, influences: Array
    ) -> Estimate:
        poles, (M, D, K) = self._matrices(record, model, orders, theta)

        def recovered(changed: Array) -> Array:
            return pack(*self._matrices(record, model, orders, changed)[1])

        return Estimate(M, D, K, _covariance(recovered, theta, influences), sort_poles(poles))

    def _matrices(
        self, record: Record, model: Model, orders: Orders, theta: Array
    ) -> tuple[np.ndarray, tuple[Array, Array, Array]]:
        """Poles and M, D, K that the coefficients theta imply."""
        hold = hold_of(record, model) if self.hold == "record" else "zoh"
        form = modal_form(from_theta(theta, record.ny, record.nu, orders), record.h, hold)
        return form[0], project(form, model, self.projection)

    def _noise_bias(
        self,
        record: Record,
        model: Model,
        orders: Orders,
        equation: DifferenceEquation,
        theta: Array,
        covariance: Array | None,
    ) -> dict[str, Any]:
        """How far M, D, K are from those of instruments, which output noise does not bias."""
        name, what = "noise_bias_over_std", "the bias that output noise gives least squares"
        parts = jackknife.blocks(record.N - orders.start, 0, 2 * (orders.start + 1))
        try:
            other, _ = instruments(record.u, record.y, orders, equation, self.rounds, parts)
            pair = [pack(*self._matrices(record, model, orders, each)[1]) for each in (theta, other)]
        except (Diverged, NotApplicable, np.linalg.LinAlgError):
            return {"warning": "whether output noise biases the least squares could not be checked"}
        return bias_remarks(pair[0] - pair[1], covariance, name, what, counted=False)


def _covariance(recovered, theta: Array, influences: Array) -> Array | None:
    """Of theta of M, D, K, from what each block adds to the coefficients."""
    J = len(influences)

    def replicate(change: Array) -> Array | None:
        try:
            return recovered(theta - change * J / (J - 1))
        except Diverged:
            return None

    return jackknife.covariance([replicate(change) for change in influences])
