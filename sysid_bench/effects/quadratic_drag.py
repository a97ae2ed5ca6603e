"""Turbulent drag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import POSITIVE, At, Effect, Knob, Seen, Suspect


@dataclass(frozen=True)
class QuadraticDrag(Effect):
    """coefficient * |v| v"""

    name: ClassVar[str] = "quadratic_drag"
    equation: ClassVar[str] = "coefficient * |v| v"
    reveals: ClassVar[str] = "a wide range of speeds in both directions"
    knobs: ClassVar[dict[str, Knob]] = {
        "coefficient": Knob("N s^2/m^2", POSITIVE),
    }

    dof: int | tuple[int, int] | None = 0
    coefficient: float = 1.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.unit("coefficient")]

    def law(self, at: At, p):
        return p.coefficient * ca.fabs(at.v) * at.v, []
