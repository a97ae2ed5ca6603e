"""A force of its own frequency, whatever the input does: mains, imbalance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import NOT_NEGATIVE, POSITIVE, At, Effect, Knob, Seen, Suspect


@dataclass(frozen=True)
class PeriodicDisturbance(Effect):
    """-amplitude * sin(2 pi frequency t + phase)"""

    name: ClassVar[str] = "periodic_disturbance"
    equation: ClassVar[str] = "-amplitude * sin(2 pi frequency t + phase)"
    reveals: ClassVar[str] = "a stretch without input"
    knobs: ClassVar[dict[str, Knob]] = {
        "amplitude": Knob("N", NOT_NEGATIVE),
        "frequency": Knob("Hz", POSITIVE),
        "phase": Knob("rad"),
    }

    dof: int | tuple[int, int] | None = 0
    amplitude: float = 1.0
    frequency: float = 1.0
    phase: float = 0.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.wave("amplitude", "phase", frequency=f) for f in seen.search("tone")]

    def law(self, at: At, p):
        return -p.amplitude * ca.sin(2 * ca.pi * p.frequency * at.t + p.phase), []
