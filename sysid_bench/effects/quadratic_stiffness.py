"""Spring that is softer on one side than on the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from sysid_bench.mechanics.effect import At, Effect, Knob, Seen, Suspect


@dataclass(frozen=True)
class QuadraticStiffness(Effect):
    """stiffness * x^2"""

    name: ClassVar[str] = "quadratic_stiffness"
    equation: ClassVar[str] = "stiffness * x^2"
    reveals: ClassVar[str] = "two static offsets"
    knobs: ClassVar[dict[str, Knob]] = {
        "stiffness": Knob("N/m^2"),
    }

    dof: int | tuple[int, int] | None = 0
    stiffness: float = 1.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.unit("stiffness")]

    def law(self, at: At, p):
        return p.stiffness * at.x * at.x, []
