"""Hardening (positive) or softening (negative) spring."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from sysid_bench.mechanics.effect import At, Effect, Knob, Seen, Suspect


@dataclass(frozen=True)
class CubicStiffness(Effect):
    """stiffness * x^3"""

    name: ClassVar[str] = "cubic_stiffness"
    equation: ClassVar[str] = "stiffness * x^3"
    reveals: ClassVar[str] = "three amplitudes"
    knobs: ClassVar[dict[str, Knob]] = {
        "stiffness": Knob("N/m^3"),
    }

    dof: int | tuple[int, int] | None = 0
    stiffness: float = 1.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.unit("stiffness")]

    def law(self, at: At, p):
        return p.stiffness * at.x * at.x * at.x, []
