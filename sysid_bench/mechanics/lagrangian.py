"""Lagrangian, dissipation, input map (CasADi) -> forced variational integrators with exact sensitivities.

The forced discrete Euler-Lagrange equations of the Galerkin action on s Gauss points, in position-momentum form:
s = 1 is the midpoint rule (order 2), s = 2 the order-4 scheme (Marsden and West, Acta Numerica 2001, 3.2 and 2.7;
Ober-Bloebaum and Saake 2015). Symplectic where nothing drives or damps; each step solves for the stage velocities.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import sqrt
from typing import Any, Protocol

import casadi as ca
import numpy as np

from sysid_bench.mechanics.rules import spline_pieces
from sysid_bench.nouns import Array, Diverged, InputError

ROOT3 = sqrt(3.0)
TABLEAUX = {
    "midpoint": (np.array([[0.5]]), np.array([1.0]), np.array([0.5])),
    "gauss2": (
        np.array([[0.25, 0.25 - ROOT3 / 6], [0.25 + ROOT3 / 6, 0.25]]),
        np.array([0.5, 0.5]),
        np.array([0.5 - ROOT3 / 6, 0.5 + ROOT3 / 6]),
    ),
}


class LagrangianSystem(Protocol):
    """n degrees of freedom, nu inputs; values() the parameters by name, in SI units.

    lagrangian(q, v, p) -> scalar; force(q, v, u, p) -> (n,) generalised force of dissipation and inputs, p a
    mapping name -> CasADi symbol. Built from CasADi operations only.
    """

    @property
    def n(self) -> int: ...

    @property
    def nu(self) -> int: ...

    def values(self) -> Mapping[str, float]: ...

    def lagrangian(self, q: Any, v: Any, p: Mapping[str, Any]) -> Any: ...

    def force(self, q: Any, v: Any, u: Any, p: Mapping[str, Any]) -> Any: ...


@dataclass(frozen=True, eq=False)
class Stepper:
    """One step in (q, v): step(x, u_stages, theta) -> x, its Jacobians, and the energy of a state."""

    step: ca.Function
    slopes: ca.Function
    energy: ca.Function
    acceleration: ca.Function
    names: tuple[str, ...]
    points: Array


@lru_cache(maxsize=32)
def stepper(system: LagrangianSystem, scheme: str, h: float) -> Stepper:
    """The integrator of a system. Raises InputError for a scheme but midpoint and gauss2."""
    if scheme not in TABLEAUX:
        raise InputError(f"scheme must be one of {', '.join(TABLEAUX)}; got {scheme!r}.")
    a, b, c = TABLEAUX[scheme]
    n, names = system.n, tuple(system.values())
    theta, x = ca.SX.sym("theta", len(names)), ca.SX.sym("x", 2 * n)
    u, V = ca.SX.sym("u", system.nu, len(b)), ca.SX.sym("V", n, len(b))
    momentum, rate, energy, acceleration = _mechanics(system, names)
    Q = x[:n] + h * ca.mtimes(V, a.T)
    P = ca.horzcat(*(momentum(Q[:, i], V[:, i], theta) for i in range(len(b))))
    Pdot = ca.horzcat(*(rate(Q[:, i], V[:, i], u[:, i], theta) for i in range(len(b))))
    p0 = momentum(x[:n], x[n:], theta)
    residual = ca.vec(P - ca.repmat(p0, 1, len(b)) - h * ca.mtimes(Pdot, a.T))
    solve = ca.rootfinder(
        "stages", "newton", {"x": ca.vec(V), "p": ca.vertcat(x, ca.vec(u), theta), "g": residual},
        {"abstol": 1e-13, "abstolStep": 1e-13, "max_iter": 60, "error_on_fail": False},
    )  # fmt: skip
    ends = ca.Function("ends", [x, u, V, theta], [x[:n] + h * ca.mtimes(V, b), p0 + h * ca.mtimes(Pdot, b)])
    velocity = _velocity(momentum, n, len(names))
    X, U, T = ca.MX.sym("x", 2 * n), ca.MX.sym("u", system.nu, len(b)), ca.MX.sym("t", len(names))
    found = solve(ca.repmat(X[n:], len(b), 1), ca.vertcat(X, ca.vec(U), T))
    q1, p1 = ends(X, U, ca.reshape(found, n, len(b)), T)
    v1 = velocity(X[n:], ca.vertcat(q1, p1, T))
    after = ca.vertcat(q1, v1)
    step = ca.Function("step", [X, U, T], [after])
    slopes = ca.Function("slopes", [X, U, T], [ca.jacobian(after, X), ca.jacobian(after, T)])
    return Stepper(step, slopes, energy, acceleration, names, c)


def _mechanics(system: LagrangianSystem, names: tuple[str, ...]) -> tuple[ca.Function, ...]:
    """momentum(q, v, theta), its rate(q, v, u, theta), energy(x, theta), acceleration(x, u, theta)."""
    n = system.n
    q, v, u = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("u", system.nu)
    theta = ca.SX.sym("theta", len(names))
    p = {name: theta[k] for k, name in enumerate(names)}
    L = system.lagrangian(q, v, p)
    momentum, slope = ca.gradient(L, v), ca.gradient(L, q) + system.force(q, v, u, p)
    mass = ca.jacobian(momentum, v)
    acceleration = ca.solve(mass, slope - ca.mtimes(ca.jacobian(momentum, q), v))
    x = ca.vertcat(q, v)
    return (
        ca.Function("momentum", [q, v, theta], [momentum]),
        ca.Function("rate", [q, v, u, theta], [slope]),
        ca.Function("energy", [x, theta], [ca.dot(momentum, v) - L]),
        ca.Function("acceleration", [x, u, theta], [acceleration]),
    )


def _velocity(momentum: ca.Function, n: int, ntheta: int) -> ca.Function:
    """v of a momentum: linear for mechanical Lagrangians, so one Newton step is exact."""
    v, known = ca.SX.sym("v", n), ca.SX.sym("known", 2 * n + ntheta)
    residual = momentum(known[:n], v, known[2 * n :]) - known[n : 2 * n]
    start = ca.Function("start", [v, known], [residual, ca.jacobian(residual, v)])
    r, J = start(v, known)
    return ca.Function("velocity", [v, known], [v - ca.solve(J, r)])


def stage_inputs(u: Array, hold: str, points: Array) -> Array:
    """(N - 1, nu, s): the held input u (N, nu) at the stages of each step."""
    if hold == "zoh":
        return np.repeat(u[:-1, :, None], len(points), axis=2)
    if hold == "foh":
        return np.stack([(1 - c) * u[:-1] + c * u[1:] for c in points], axis=2)
    pieces = spline_pieces(u)
    return np.stack([sum(pieces[k] * c**k for k in range(4)) for c in points], axis=2)


def trajectory(made: Stepper, theta: Array, x0: Array, stages: Array) -> Array:
    """x (N, 2n) = [q, v] at the samples. Raises Diverged where it leaves the finite numbers."""
    count, nu, s = stages.shape
    inputs = stages.transpose(1, 0, 2).reshape(nu, count * s)
    found = made.step.mapaccum(count)(x0, inputs, np.tile(theta[:, None], (1, count)))
    x = np.vstack([x0, np.array(found).T])
    if not np.all(np.isfinite(x)):
        raise Diverged("the simulated motion is not finite.")
    return x


def sensitivities(made: Stepper, theta: Array, x: Array, stages: Array) -> Array:
    """dx/d(theta, x0) (N, 2n, np + 2n) along a trajectory x, by its exact recursion."""
    count, nu, s = stages.shape
    nx, ntheta = x.shape[1], len(theta)
    inputs = stages.transpose(1, 0, 2).reshape(nu, count * s)
    A, B = made.slopes.map(count)(x[:-1].T, inputs, np.tile(theta[:, None], (1, count)))
    A = np.array(A).reshape(nx, count, nx).transpose(1, 0, 2)
    B = np.array(B).reshape(nx, count, ntheta).transpose(1, 0, 2)
    S = np.zeros((count + 1, nx, ntheta + nx))
    S[0, :, ntheta:] = np.eye(nx)
    for k in range(count):
        S[k + 1] = A[k] @ S[k]
        S[k + 1, :, :ntheta] += B[k]
    return S
