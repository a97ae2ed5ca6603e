"""What an emulated device's sensors, actuators and clock do to the ideal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid_bench.nouns import Array, InputError

LARGEST = 1e100  # number that still leaves room to work with


@dataclass(frozen=True)
class Hardware:
    """Imperfections of the emulated device.

    noise_rms      white sensor noise, in the outputs' unit; one number for all channels
    quantisation   step of the sensors before the bus' own, in the outputs' unit; 0: none
    actuator_limit forces saturate here, in the inputs' unit; null: never
    drift_ppm      the device's second is this much longer than a true one
    jitter_s       sampling instants are off by up to this much (uniform); the tick shows it
    seed           of noise and jitter
    """

    noise_rms: float = 0.0
    quantisation: float = 0.0
    actuator_limit: float | None = None
    drift_ppm: float = 0.0
    jitter_s: float = 0.0
    seed: int = 1

    def __post_init__(self) -> None:
        for name in ("noise_rms", "quantisation", "jitter_s", "seed"):
            if not 0 <= getattr(self, name) < LARGEST:
                raise InputError(f"hardware.{name} must be 0 to {LARGEST:g}; got {getattr(self, name)!r}.")
        if not abs(self.drift_ppm) <= 1e5:
            raise InputError(
                f"hardware.drift_ppm={self.drift_ppm:g}: a clock that is off by more than 10 % is none."
            )

    def sense(self, y: Array, rng: np.random.Generator) -> Array:
        """(ny,) what the sensor gives for the true y."""
        y = y + self.noise_rms * rng.standard_normal(y.shape)
        return np.round(y / self.quantisation) * self.quantisation if self.quantisation else y

    def actuate(self, force: Array) -> Array:
        """(nu,) what pushes on the plant for the force asked for."""
        limit = self.actuator_limit
        return force if limit is None else np.clip(force, -limit, limit)
