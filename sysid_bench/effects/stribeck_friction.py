"""Dry friction that is larger at rest than when sliding (Stribeck)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import NOT_NEGATIVE, POSITIVE, At, Effect, Knob


@dataclass(frozen=True)
class StribeckFriction(Effect):
    """(force + (static_force - force) * exp(-(v / stribeck_speed)^2)) * sign(v); the sign is smoothed over `speed`"""

    name: ClassVar[str] = "stribeck_friction"
    equation: ClassVar[str] = "(force + (static_force - force) * exp(-(v / stribeck_speed)^2)) * sign(v)"
    reveals: ClassVar[str] = "slow ramps through zero speed"
    knobs: ClassVar[dict[str, Knob]] = {
        "force": Knob("N", NOT_NEGATIVE),
        "static_force": Knob("N", POSITIVE),
        "stribeck_speed": Knob("m/s", POSITIVE),
        "speed": Knob("m/s", NOT_NEGATIVE),
    }

    dof: int | tuple[int, int] | None = 0
    force: float = 1.0
    static_force: float = 1.5
    stribeck_speed: float = 0.1
    speed: float = 0.0

    def law(self, at: At, p):
        sticking = 1e-3 * at.mobility * (p.force + ca.fabs(p.static_force))
        level = p.force + (p.static_force - p.force) * ca.exp(-((at.v / p.stribeck_speed) ** 2))
        return level * ca.tanh(at.v / (p.speed + sticking)), []
