"""plant, excitation, noise, sampling, seed -> record, noise-free output. Exact; nonlinear plants finely integrated."""

from __future__ import annotations

from dataclasses import asdict, dataclass, is_dataclass
from typing import Any

import numpy as np

from sysid_bench.mechanics.holds import propagate
from sysid_bench.mechanics.simulate import continuous, equilibrium, response, simulate_hidden_step
from sysid_bench.nouns import (
    Acquired,
    Array,
    Excitation,
    InputError,
    Noise,
    Plant,
    Record,
    Sampling,
    Signal,
)

STARTS = ("zero", "equilibrium", "random")


@dataclass(frozen=True)
class Simulation:
    """initial_state: zero (q = q' = 0) | equilibrium (at rest under the first sample of the force) | random
    (Gaussian, each state with the rms it has in the run from zero).
    hidden_step_s: null, exact; or the thesis' T_s in s: the force reaches the plant through a zero-order hold of
    this step, on average hidden_step_s / 2 late.
    substeps: integration steps per sample for plants with effects (linear ones need none).
    """

    initial_state: str = "zero"
    hidden_step_s: float | None = None
    substeps: int = 8

    def __post_init__(self) -> None:
        if self.initial_state not in STARTS:
            raise InputError(
                f"source.initial_state must be one of {', '.join(STARTS)}; got {self.initial_state!r}."
            )

    def acquire(
        self, plant: Plant, excitation: Excitation, noise: Noise, sampling: Sampling, rng: np.random.Generator
    ) -> Acquired:
        """One record with its noise-free output and noise variance.

        Raises InputError where hidden_step_s does not divide h, or is wanted of a bandlimited signal or a
        nonlinear plant, and where the output of a linear plant overflows.
        """
        N, h = sampling.N, sampling.h_s
        signal = excitation.signal(N, h, plant.nu, rng)
        x0 = self._initial_state(plant, signal, h, rng)
        y_true = self._output(plant, signal, h, x0)
        if plant.is_linear and not np.all(np.isfinite(y_true)):
            raise InputError(
                "the simulated output overflows: the plant is unstable over this record. Shorten it."
            )
        y, variance = noise.apply(y_true, h, rng)
        record = Record(
            h * np.arange(N), signal.u, y, hold=signal.hold, period=signal.period, units=_units(plant),
            origin=self._origin(excitation, noise, sampling),
        )  # fmt: skip
        return Acquired(record, y_true, variance)

    def _initial_state(self, plant: Plant, signal: Signal, h: float, rng: np.random.Generator) -> Array:
        if self.initial_state == "zero":
            return np.zeros(2 * plant.n)
        if self.initial_state == "equilibrium":
            return equilibrium(plant, signal.u[0])
        A, B, _, _ = continuous(plant)
        x = propagate(A, B, signal.u, h, signal.hold, None, signal.period, signal.series)
        return x.std(axis=0) * rng.standard_normal(2 * plant.n)

    def _output(self, plant: Plant, signal: Signal, h: float, x0: Array) -> Array:
        if not plant.is_linear:
            return self._integrate(plant, signal, h, x0)
        if self.hidden_step_s is None:
            return response(plant, signal, h, x0)
        if signal.hold == "bandlimited":
            raise InputError(
                "source.hidden_step_s is for zoh, foh and cubic signals; this one is bandlimited."
            )
        return simulate_hidden_step(plant, signal.u, h, signal.hold, self.hidden_step_s, x0)

    def _integrate(self, plant: Plant, signal: Signal, h: float, x0: Array) -> Array:
        from sysid_bench.mechanics import nonlinear  # compiles loops: only where a plant has effects

        if self.hidden_step_s is not None:
            raise InputError("source.hidden_step_s is for linear plants; this one has effects.")
        motion = nonlinear.simulate(
            plant, signal.u, h, signal.hold, x0=x0, substeps=self.substeps, period=signal.period,
            series=signal.series,
        )  # fmt: skip
        return motion.y

    def _origin(self, excitation: Excitation, noise: Noise, sampling: Sampling) -> dict[str, Any]:
        return {
            "source": _settings(self),
            "excitation": _settings(excitation),
            "noise": _settings(noise),
            "sampling": _settings(sampling),
        }


def _settings(thing: Any) -> dict[str, Any]:
    knobs = asdict(thing) if is_dataclass(thing) and not isinstance(thing, type) else {}
    return {"class": type(thing).__name__} | knobs


def _units(plant: Plant) -> dict[str, Any]:
    """Seconds, and the plant's units where they fit its channels and what its sensors measure."""
    fits = {"u": plant.nu, "y": plant.ny}
    said = {c: plant.units.get(c) for c in fits}
    units = {
        c: [str(x) for x in v] for c, v in said.items() if isinstance(v, list | tuple) and len(v) == fits[c]
    }
    if plant.output != "displacement" and not all("/s" in unit for unit in units.get("y", [])):
        del units["y"]  # a plant of metres with its output switched to accelerations
    return {"t": "s"} | units
