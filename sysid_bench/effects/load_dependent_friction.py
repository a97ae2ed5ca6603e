"""Dry friction that grows with the load the spring carries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import NOT_NEGATIVE, POSITIVE, At, Effect, Knob, Seen, Suspect


@dataclass(frozen=True)
class LoadDependentFriction(Effect):
    """coefficient * |x| * sign(v)"""

    name: ClassVar[str] = "load_dependent_friction"
    equation: ClassVar[str] = "coefficient * |x| * sign(v)"
    reveals: ClassVar[str] = "two loads at the same speed"
    knobs: ClassVar[dict[str, Knob]] = {
        "coefficient": Knob("N/m", POSITIVE),
        "speed": Knob("m/s", NOT_NEGATIVE),
    }

    sign: ClassVar[Callable] = staticmethod(ca.tanh)  # how the step is rounded

    dof: int | tuple[int, int] | None = 0
    coefficient: float = 1.0
    speed: float = 0.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.unit("coefficient", speed=0.01 * seen.v_rms)]

    def law(self, at: At, p):
        level = p.coefficient * ca.fabs(at.x)
        return level * self.sign(at.v / (p.speed + 1e-3 * at.mobility * level + 1e-12)), []
