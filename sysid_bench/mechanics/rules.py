"""name of a hold or integrator -> how one step of x' = A x + B u is taken, as functions of A.

Every rule reads x[k+1] = R(hA) x[k] + h sum_p W_p(hA) B c_p[k] with c_p[k] linear in the samples of u.
Exact for what their name says of the input between samples: `zoh`, `foh`, `cubic` (the not-a-knot spline).
Geometric integrators: `cayley` (midpoint variational integrator, R = (1 + z/2)/(1 - z/2), input averaged over
the step; `cayley_zoh`: held over the step) and `gauss2` (two-stage Gauss collocation, order 4, input taken from
the spline at the stages).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import factorial, sqrt

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg.lapack import dgtsv

from sysid_bench.mechanics.exponential import exponential
from sysid_bench.mechanics.phi import phi
from sysid_bench.nouns import Array, Complex, InputError

STAGE = sqrt(3) / 6  # the Gauss points are 1/2 -+ STAGE of the step


@dataclass(frozen=True)
class Rule:
    """One step of x' = A x + B u (see the head of this file).

    step(A, B, h)    -> R(hA) (nx, nx) and the h W_p(hA) B as (P, nx, nu)
    coefficients(u)  -> c (P, N-1, nu) of the steps between the N samples u (N, nu)
    functions(z)     -> R and the W_p of complex z, stacked (1+P, *z.shape)
    slopes(z)        -> their derivatives, same shape
    """

    name: str
    step: Callable[[Array, Array, float], tuple[Array, Array]]
    coefficients: Callable[[Array], Array]
    functions: Callable[[Complex], Complex]
    slopes: Callable[[Complex], Complex]


def exponential_step(A: Array, B: Array, h: float, degree: int) -> tuple[Array, Array]:
    """Ad (nx, nx), Bd (degree + 1, nx, nu) from one exponential of [x; u; u'; ...]: A may be singular or defective."""
    nx, nu = B.shape
    size = nx + nu * (degree + 1)
    generator = np.zeros((size, size))
    generator[:nx, :nx], generator[:nx, nx : nx + nu] = h * A, h * B
    generator[nx : size - nu, nx + nu :] = np.eye(size - nu - nx)
    E = exponential(generator)[:nx]
    weights = [factorial(p) * E[:, nx + p * nu : nx + (p + 1) * nu] for p in range(degree + 1)]
    return E[:, :nx], np.array(weights)


def exponential_functions(z: Complex, degree: int) -> Complex:
    """exp(z) and p! phi_{p+1}(z), p = 0 .. degree: (degree + 2, *z.shape)."""
    values = phi(z, degree + 1)
    return np.array([values[0], *(factorial(p) * values[p + 1] for p in range(degree + 1))])


def exponential_slopes(z: Complex, degree: int) -> Complex:
    """By phi_p' = phi_p - p phi_{p+1}."""
    values = phi(z, degree + 2)
    weights = [factorial(p) * (values[p + 1] - (p + 1) * values[p + 2]) for p in range(degree + 1)]
    return np.array([values[0], *weights])


def spline_pieces(u: Array) -> Array:
    """c (4, N-1, nu): u(t_k + s h) = sum_p c_p[k] s^p of the not-a-knot cubic spline through u (N, nu)."""
    if len(u) == 2:
        return np.array([u[:-1], np.diff(u, axis=0), 0 * u[:-1], 0 * u[:-1]])
    if len(u) == 3:
        return CubicSpline(np.arange(3), u).c[::-1]
    rise, slope = np.diff(u, axis=0), spline_slopes(u)
    bend = slope[:-1] + slope[1:] - 2 * rise
    return np.array([u[:-1], slope[:-1], rise - slope[:-1] - bend, bend])


def spline_slopes(u: Array) -> Array:
    """(N, nu) of the not-a-knot spline with unit knots, N > 3: one tridiagonal solution, a fifth of CubicSpline's time."""
    rise = np.diff(u, axis=0)
    right = np.empty_like(u, dtype=float)
    right[1:-1] = 3 * (rise[:-1] + rise[1:])
    right[0], right[-1] = (5 * rise[0] + rise[1]) / 2, (5 * rise[-1] + rise[-2]) / 2
    side, middle = np.ones((2, len(u) - 1)), np.full(len(u), 4.0)
    side[0, -1] = side[1, 0] = 2.0
    middle[[0, -1]] = 1.0
    return dgtsv(side[0], middle, side[1], right)[3]


def _lines(u: Array) -> Array:
    return np.array([u[:-1], np.diff(u, axis=0)])


def _averages(u: Array) -> Array:
    return 0.5 * (u[None, :-1] + u[None, 1:])


def _stages(u: Array) -> Array:
    c = spline_pieces(u)
    return np.array([sum(c[p] * s**p for p in range(4)) for s in (0.5 - STAGE, 0.5 + STAGE)])


def _cayley_step(A: Array, B: Array, h: float) -> tuple[Array, Array]:
    eye, half = np.eye(len(A)), 0.5 * h * A
    solved = np.linalg.solve(eye - half, np.hstack([eye + half, h * B]))
    return solved[:, : len(A)], solved[None, :, len(A) :]


def _cayley_functions(z: Complex) -> Complex:
    return np.array([1 + z / 2, np.ones_like(z)]) / (1 - z / 2)


def _cayley_slopes(z: Complex) -> Complex:
    return np.array([np.ones_like(z), np.full_like(z, 0.5)]) / (1 - z / 2) ** 2


def _gauss_step(A: Array, B: Array, h: float) -> tuple[Array, Array]:
    Z, eye, nx, nu = h * A, np.eye(len(A)), len(A), B.shape[1]
    even, odd = eye + Z @ Z / 12, Z / 2
    stages = [0.5 * h * (B + sign * STAGE * Z @ B) for sign in (1, -1)]
    solved = np.linalg.solve(even - odd, np.hstack([even + odd, *stages]))
    return solved[:, :nx], np.array([solved[:, nx : nx + nu], solved[:, nx + nu :]])


def _gauss_functions(z: Complex) -> Complex:
    below = 1 - z / 2 + z**2 / 12
    return np.array([1 + z / 2 + z**2 / 12, 0.5 * (1 + STAGE * z), 0.5 * (1 - STAGE * z)]) / below


def _gauss_slopes(z: Complex) -> Complex:
    below, fall = 1 - z / 2 + z**2 / 12, -0.5 + z / 6
    rise = np.array([0.5 + z / 6, np.full_like(z, STAGE / 2), np.full_like(z, -STAGE / 2)])
    return (rise - _gauss_functions(z) * fall) / below


def _exact(name: str, degree: int, coefficients: Callable[[Array], Array]) -> Rule:
    return Rule(
        name,
        partial(exponential_step, degree=degree),
        coefficients,
        partial(exponential_functions, degree=degree),
        partial(exponential_slopes, degree=degree),
    )


RULES = {
    "zoh": _exact("zoh", 0, lambda u: u[None, :-1]),
    "foh": _exact("foh", 1, _lines),
    "cubic": _exact("cubic", 3, spline_pieces),
    "cayley": Rule("cayley", _cayley_step, _averages, _cayley_functions, _cayley_slopes),
    "cayley_zoh": Rule("cayley_zoh", _cayley_step, lambda u: u[None, :-1], _cayley_functions, _cayley_slopes),
    "gauss2": Rule("gauss2", _gauss_step, _stages, _gauss_functions, _gauss_slopes),
}


def rule(name: str) -> Rule:
    """The rule of that name. Raises InputError for any other, `bandlimited` (no step by step rule) included."""
    if name not in RULES:
        raise InputError(f"hold must be one of {', '.join(RULES)} here; got {name!r}.")
    return RULES[name]
