"""Cogging, or the pitch of a screw: a force periodic in position."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import NOT_NEGATIVE, POSITIVE, At, Effect, Knob, Seen, Suspect


@dataclass(frozen=True)
class PositionRipple(Effect):
    """-amplitude * sin(2 pi x / pitch + phase)"""

    name: ClassVar[str] = "position_ripple"
    equation: ClassVar[str] = "-amplitude * sin(2 pi x / pitch + phase)"
    reveals: ClassVar[str] = "three cruise speeds"
    knobs: ClassVar[dict[str, Knob]] = {
        "amplitude": Knob("N", NOT_NEGATIVE),
        "pitch": Knob("m", POSITIVE),
        "phase": Knob("rad"),
    }

    dof: int | tuple[int, int] | None = 0
    amplitude: float = 1.0
    pitch: float = 0.1
    phase: float = 0.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.wave("amplitude", "phase", pitch=p) for p in seen.search("pitch")]

    def law(self, at: At, p):
        return -p.amplitude * ca.sin(2 * ca.pi * at.x / p.pitch + p.phase), []
