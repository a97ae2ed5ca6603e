"""Lagrangian system, h, N -> error and energy drift of variational integrators beside RK4 and DOP853."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from sysid_bench.mechanics.lagrangian import Stepper, stage_inputs, stepper, trajectory
from sysid_bench.nouns import Array, InputError, Plant, Sampling

REFERENCE_RTOL = 1e-12


@dataclass(frozen=True)
class LagrangianIntegrators:
    """system: a Lagrangian system (group lagrangian); q0: initial coordinates; at rest, not driven.

    Returns for midpoint, gauss2, rk4 and dop853 (rtol loose_rtol): NAME_error, rms distance of q from a DOP853
    at rtol 1e-12 over the first compared_s seconds; NAME_energy, greatest |E - E0| / |E0 - E_rest| in the last tenth.
    """

    system: Any
    q0: list[float]
    compared_s: float = 10.0
    loose_rtol: float = 1e-6

    def compute(self, plant: Plant, sampling: Sampling, rng: np.random.Generator) -> dict[str, float]:
        """The plant plays no part."""
        n, h, N = self.system.n, sampling.h_s, sampling.N
        if len(self.q0) != n:
            raise InputError(f"q0 must have {n} coordinates; got {len(self.q0)}.")
        made = {name: stepper(self.system, name, h) for name in ("midpoint", "gauss2")}
        theta, x0 = np.array(list(self.system.values().values())), np.array([*self.q0, *np.zeros(n)])
        field = _vector_field(made["midpoint"], theta, n, self.system.nu)
        t, near = h * np.arange(N), h * np.arange(N) <= self.compared_s
        still = np.zeros((N, self.system.nu))
        paths = {
            name: trajectory(one, theta, x0, stage_inputs(still, "zoh", one.points))
            for name, one in made.items()
        }
        paths["rk4"] = _rk4(field, x0, h, N)
        paths["dop853"] = solve_ivp(
            field, (0, t[-1]), x0, "DOP853", t_eval=t, rtol=self.loose_rtol, atol=1e-9
        ).y.T
        exact = solve_ivp(
            field, (0, t[near][-1]), x0, "DOP853", t_eval=t[near], rtol=REFERENCE_RTOL, atol=1e-13
        ).y.T
        energy = _energy(made["midpoint"], theta)
        span = abs(energy(x0[None])[0] - energy(np.zeros((1, 2 * n)))[0])
        numbers = {}
        for name, x in paths.items():
            numbers[f"{name}_error"] = float(np.sqrt(np.mean((x[near, :n] - exact[:, :n]) ** 2)))
            drift = np.abs(energy(x[-max(N // 10, 1) :]) - energy(x0[None])[0])
            numbers[f"{name}_energy"] = float(drift.max() / span)
        return numbers


def _vector_field(made: Stepper, theta: Array, n: int, nu: int) -> Callable[[float, Array], Array]:
    def field(_t: float, x: Array) -> Array:
        return np.concatenate([x[n:], np.array(made.acceleration(x, np.zeros(nu), theta)).ravel()])

    return field


def _energy(made: Stepper, theta: Array) -> Callable[[Array], Array]:
    return lambda x: np.array(made.energy.map(len(x))(x.T, np.tile(theta[:, None], (1, len(x))))).ravel()


def _rk4(field: Callable[[float, Array], Array], x0: Array, h: float, N: int) -> Array:
    x = np.empty((N, len(x0)))
    x[0] = x0
    for k in range(N - 1):
        k1 = field(0, x[k])
        k2 = field(0, x[k] + h / 2 * k1)
        k3 = field(0, x[k] + h / 2 * k2)
        k4 = field(0, x[k] + h * k3)
        x[k + 1] = x[k] + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x
