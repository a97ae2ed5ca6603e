"""Dry friction that is a spring before it slides (Dahl 1968)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import POSITIVE, At, Effect, Knob, Seen, Suspect


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

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self._sliding_after(share * seen.x_rms) for share in (0.03, 0.08, 0.2, 0.5)]

    def _sliding_after(self, displacement: float) -> Suspect:
        one = replace(self, force=1.0, stiffness=1.0 / displacement)

        def make(c):
            return (
                replace(self, force=float(c[0]), stiffness=float(c[0]) / displacement) if c[0] > 0 else None
            )

        return Suspect((one,), make)

    def law(self, at: At, p):
        dx = at.x - at.x_before
        end = ca.sign(dx) * p.force / p.stiffness
        z = end + (at.z[0] - end) * ca.exp(-ca.fabs(dx) * p.stiffness / p.force)
        return p.stiffness * z, [z]
