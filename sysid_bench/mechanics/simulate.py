"""linear model or plant, input signal -> noise-free output at the samples, exactly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sysid_bench.mechanics.holds import propagate, recursion
from sysid_bench.mechanics.rules import RULES, rule
from sysid_bench.mechanics.second_order import state_space
from sysid_bench.nouns import Array, InputError, Model, Plant, Signal

MOST_STEPS = 1_000_000


def continuous(model: Model | Plant) -> tuple[Array, Array, Array, Array]:
    """(A, B, C, D) of a model's values. Raises InputError where it has none."""
    return state_space(*model.matrices, model.input_map, model.output_map, model.output)


def simulate(
    model: Model | Plant,
    u: Array,
    h: float,
    hold: str,
    x0: Array | None = None,
    period: int | None = None,
    series: tuple[Array, NDArray[np.complex128]] | None = None,
) -> Array:
    """y (N, ny) of a linear model for u (N, nu), h in s; x0 = [q; q'] (2n,) in m, m/s, zero where None.

    hold as in holds.propagate. Raises InputError for a model without values or with effects.
    """
    if model.effects:
        raise InputError(
            "simulate is for linear models; one with effects is integrated by mechanics.nonlinear."
        )
    A, B, C, D = continuous(model)
    return propagate(A, B, u, h, hold, x0, period, series) @ C.T + u @ D.T


def simulate_hidden_step(
    model: Model | Plant, u: Array, h: float, hold: str, step_s: float, x0: Array | None = None
) -> Array:
    """y (N, ny) where the input is sampled every step_s and held (Bruschetta 2011, section 5.1: T_s).

    u(t), given by its samples every h and `hold` (zoh, foh, cubic), reaches the plant as a staircase: on average
    it comes step_s / 2 late, which is the error this layer puts into otherwise exact data. Closed form: the
    steps within one h are summed once. Raises InputError where step_s does not divide h.
    """
    m = steps_within(h, step_s, "hidden_step_s", "sampling.h_s")
    A, B, C, D = continuous(model)
    x0 = np.zeros(len(A)) if x0 is None else np.asarray(x0, float)
    Ad, (Bd,) = RULES["zoh"].step(A, B, h / m)
    pieces = rule(hold).coefficients(u)
    powers = (np.arange(m) / m)[:, None] ** np.arange(len(pieces))
    weights = np.zeros((len(pieces), *B.shape))
    for instant in powers:
        weights = Ad @ weights + instant[:, None, None] * Bd
    forcing = np.einsum("pxu,pku->kx", weights, pieces, optimize=True)
    return recursion(np.linalg.matrix_power(Ad, m), forcing, x0) @ C.T + u @ D.T


def steps_within(long_s: float, short_s: float, short_name: str, long_name: str) -> int:
    """How often short_s goes into long_s. Raises InputError where it does not go in a whole number of times."""
    if not np.isfinite([float(long_s), float(short_s)]).all():
        raise InputError(
            f"{short_name} and {long_name} must be finite times in s; got {short_s} and {long_s}."
        )
    count = round(min(long_s / short_s, MOST_STEPS + 1)) if short_s > 0 else 0
    if count > MOST_STEPS:
        raise InputError(
            f"{short_name} = {short_s:g} s goes more than {MOST_STEPS:,} times into {long_name}."
        )
    if count < 1 or abs(count * short_s - long_s) > 1e-6 * long_s:
        raise InputError(
            f"{short_name} must divide {long_name}; got {short_name} = {short_s:g} s and {long_name} = {long_s:g} s. "
            f"Nearest that fits: {long_s / max(count, 1):.6g} s."
        )
    return count


def equilibrium(model: Model | Plant, u0: Array) -> Array:
    """x0 = [q; 0] at which u0 (nu,) holds the model at rest. Raises InputError for a singular stiffness."""
    _, _, K = model.matrices
    if np.linalg.matrix_rank(K) < model.n:
        raise InputError(
            "an equilibrium needs a regular stiffness; this plant can move freely as a rigid body."
        )
    return np.concatenate([np.linalg.solve(K, model.input_map @ u0), np.zeros(model.n)])


def response(model: Model | Plant, signal: Signal, h: float, x0: Array | None = None) -> Array:
    """y (N, ny) of a linear model for a Signal."""
    return simulate(model, signal.u, h, signal.hold, x0, signal.period, signal.series)
