"""A force that is always there: gravity, preload, offset of the drive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from sysid_bench.mechanics.effect import At, Effect, Knob, Seen, Suspect


@dataclass(frozen=True)
class ConstantForce(Effect):
    """-force"""

    name: ClassVar[str] = "constant_force"
    equation: ClassVar[str] = "-force"
    reveals: ClassVar[str] = "a start at rest, and a second pose"
    knobs: ClassVar[dict[str, Knob]] = {
        "force": Knob("N"),
    }

    dof: int | tuple[int, int] | None = 0
    force: float = 1.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.unit("force")]

    def law(self, at: At, p):
        return -p.force, []
