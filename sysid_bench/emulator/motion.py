"""plant, force held over a step -> its motion, exactly where the plant is linear."""

from __future__ import annotations

from functools import lru_cache
from typing import Protocol

import numpy as np

from sysid_bench.mechanics.exponential import exponential
from sysid_bench.mechanics.second_order import state_space
from sysid_bench.nouns import Array, InputError, Plant


class Motion(Protocol):
    """The plant between two samples."""

    def advance(self, force: Array, dt: float) -> None:
        """Hold force (nu,) for dt seconds."""
        ...

    def outputs(self, force: Array) -> Array:
        """(ny,) what the sensors would show now, without noise."""
        ...

    def velocities(self) -> Array:
        """(n,) m/s."""
        ...


class LinearMotion:
    """x1 = Ad x0 + Bd u, the exact zero-order-hold step, for any step length."""

    def __init__(self, plant: Plant) -> None:
        A, B, self._C, self._Dd = state_space(
            plant.mass, plant.damping, plant.stiffness, plant.input_map, plant.output_map, plant.output
        )
        self._n = plant.n
        self._x = np.zeros(len(A))
        self._step = lru_cache(maxsize=256)(lambda dt: _zoh(A, B, dt))

    def advance(self, force: Array, dt: float) -> None:
        Ad, Bd = self._step(dt)
        self._x = Ad @ self._x + Bd @ force

    def outputs(self, force: Array) -> Array:
        return self._C @ self._x + self._Dd @ force

    def velocities(self) -> Array:
        return self._x[self._n :]


class NonlinearMotion:
    """Plants with effects, by the suite's simulation of them; steps of one length only."""

    def __init__(self, plant: Plant, h: float) -> None:
        from sysid_bench.mechanics.stepper import Stepper  # compiles loops: only where a plant has effects

        Stepper(plant, h).step(np.zeros(plant.nu))  # compiled now: a tick does not wait
        self._stepper, self._n = Stepper(plant, h), plant.n
        self._y = np.asarray(self._stepper.measure())

    def advance(self, force: Array, dt: float) -> None:
        if abs(dt - self._stepper.h) > 1e-9 * dt:
            raise InputError("an emulated plant with effects takes no sampling jitter; set clock.jitter_s=0.")
        self._y = self._stepper.step(force)

    def outputs(self, force: Array) -> Array:
        return self._y

    def velocities(self) -> Array:
        x = self._stepper.x
        return x[len(x) // 2 :][: self._n]


def motion_of(plant: Plant, h: float) -> Motion:
    """The plant at rest. h: true step length in s."""
    return LinearMotion(plant) if plant.is_linear else NonlinearMotion(plant, h)


def _zoh(A: Array, B: Array, dt: float) -> tuple[Array, Array]:
    nx, nu = B.shape
    E = exponential(np.block([[A, B], [np.zeros((nu, nx + nu))]]) * dt)
    return E[:nx, :nx].copy(), E[:nx, nx:].copy()
