"""Dry friction that is larger at rest than when sliding (Stribeck)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import NOT_NEGATIVE, POSITIVE, At, Effect, Knob, Seen, Suspect


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

    sign: ClassVar[Callable] = staticmethod(ca.tanh)  # how the step is rounded

    dof: int | tuple[int, int] | None = 0
    force: float = 1.0
    static_force: float = 1.5
    stribeck_speed: float = 0.1
    speed: float = 0.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self._at(share * seen.v_rms, 0.01 * seen.v_rms) for share in (0.1, 0.2, 0.4, 0.8)]

    def _at(self, stribeck_speed: float, speed: float) -> Suspect:
        at = replace(self, stribeck_speed=stribeck_speed, speed=speed)
        sliding, sticking = (
            replace(at, force=1.0, static_force=1e-300),
            replace(at, force=0.0, static_force=1.0),
        )

        def make(c):
            if c[1] <= 0 or c[1] < c[0] or c[0] < -0.3 * c[1]:
                return None
            return replace(at, force=max(float(c[0]), 0.1 * float(c[1])), static_force=float(c[1]))

        return Suspect((sliding, sticking), make)

    def law(self, at: At, p):
        sticking = 1e-3 * at.mobility * (p.force + ca.fabs(p.static_force))
        level = p.force + (p.static_force - p.force) * ca.exp(-((at.v / p.stribeck_speed) ** 2))
        return level * self.sign(at.v / (p.speed + sticking + 1e-300)), []
