"""Dry friction of constant size. Steps at v = 0, sticks below its force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import NOT_NEGATIVE, POSITIVE, At, Effect, Knob, Seen, Suspect


@dataclass(frozen=True)
class CoulombFriction(Effect):
    """force * sign(v); the sign is smoothed over `speed`"""

    name: ClassVar[str] = "coulomb_friction"
    equation: ClassVar[str] = "force * sign(v)"
    reveals: ClassVar[str] = "two speeds or amplitudes, with reversals"
    knobs: ClassVar[dict[str, Knob]] = {
        "force": Knob("N", POSITIVE),
        "speed": Knob("m/s", NOT_NEGATIVE),
    }

    sign: ClassVar[Callable] = staticmethod(ca.tanh)  # how the step is rounded

    dof: int | tuple[int, int] | None = 0
    force: float = 1.0
    speed: float = 0.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.unit("force", speed=0.01 * seen.v_rms)]

    def law(self, at: At, p):
        sticking = 1e-3 * at.mobility * p.force
        return p.force * self.sign(at.v / (p.speed + sticking + 1e-300)), []
