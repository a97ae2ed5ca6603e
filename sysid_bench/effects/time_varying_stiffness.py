"""Stiffness that changes while the record runs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import NOT_NEGATIVE, At, Effect, Knob, Seen, Suspect


@dataclass(frozen=True)
class TimeVaryingStiffness(Effect):
    """(slope * t + curvature * t^2 + amplitude * sin(2 pi frequency t + phase)) * x"""

    name: ClassVar[str] = "time_varying_stiffness"
    equation: ClassVar[str] = "(slope * t + curvature * t^2 + amplitude * sin(2 pi frequency t + phase)) * x"
    reveals: ClassVar[str] = "the first block repeated at the end"
    knobs: ClassVar[dict[str, Knob]] = {
        "slope": Knob("N/(m s)"),
        "curvature": Knob("N/(m s^2)"),
        "amplitude": Knob("N/m", NOT_NEGATIVE),
        "frequency": Knob("Hz", NOT_NEGATIVE),
        "phase": Knob("rad"),
    }

    dof: int | tuple[int, int] | None = 0
    slope: float = 0.0
    curvature: float = 0.0
    amplitude: float = 0.0
    frequency: float = 1.0
    phase: float = 0.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        swings = [self.wave("amplitude", "phase", frequency=f) for f in seen.search("modulation")]
        still = replace(self, amplitude=0.0)
        drift = (replace(still, slope=1.0), replace(still, slope=0.0, curvature=1.0))
        return [
            Suspect(drift, lambda c: replace(still, slope=float(c[0]), curvature=float(c[1]))),
            self.unit("slope", amplitude=0.0),
            *swings,
        ]

    def law(self, at: At, p):
        t = at.t
        swing = p.amplitude * ca.sin(2 * ca.pi * p.frequency * t + p.phase)
        return (p.slope * t + p.curvature * t**2 + swing) * at.x, []
