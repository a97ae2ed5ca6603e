"""Friction that differs between the two directions: a worn screw, a one-sided seal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import At, Effect, Knob, Seen, Suspect


@dataclass(frozen=True)
class AsymmetricFriction(Effect):
    """damping * |v|: half the difference of the viscous friction between v > 0 and v < 0"""

    name: ClassVar[str] = "asymmetric_friction"
    equation: ClassVar[str] = "damping * |v|"
    reveals: ClassVar[str] = "both directions at several speeds"
    knobs: ClassVar[dict[str, Knob]] = {"damping": Knob("N s/m")}

    dof: int | tuple[int, int] | None = 0
    damping: float = 1.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.unit("damping")]

    def law(self, at: At, p):
        return p.damping * ca.fabs(at.v), []
