"""Dry friction that is a spring before it slides (Dahl 1968)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import POSITIVE, At, Effect, Knob


@dataclass(frozen=True)
class PreslidingFriction(Effect):
    """stiffness * z, dz/dx = 1 - sign(v) stiffness z / force"""

    name: ClassVar[str] = "presliding_friction"
    states: ClassVar[int] = 1
    equation: ClassVar[str] = "stiffness * z, dz/dx = 1 - sign(v) stiffness z / force"
    reveals: ClassVar[str] = "small reversals, well below the breakaway displacement"
    knobs: ClassVar[dict[str, Knob]] = {
        "force": Knob("N", POSITIVE),
        "stiffness": Knob("N/m", POSITIVE),
    }

    dof: int | tuple[int, int] | None = 0
    force: float = 1.0
    stiffness: float = 100.0

    def law(self, at: At, p):
        dx = at.x - at.x_before
        end = ca.sign(dx) * p.force / p.stiffness
        z = end + (at.z[0] - end) * ca.exp(-ca.fabs(dx) * p.stiffness / p.force)
        return p.stiffness * z, [z]
