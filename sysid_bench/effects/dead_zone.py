"""Clearance: the spring does nothing within the gap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import POSITIVE, At, Effect, Knob, Seen, Suspect


@dataclass(frozen=True)
class DeadZone(Effect):
    """-stiffness * clip(x, -gap, gap); the model's own stiffness holds outside the gap"""

    name: ClassVar[str] = "dead_zone"
    equation: ClassVar[str] = "-stiffness * clip(x, -gap, gap)"
    reveals: ClassVar[str] = "two amplitudes, one below the gap"
    knobs: ClassVar[dict[str, Knob]] = {
        "stiffness": Knob("N/m", POSITIVE),
        "gap": Knob("m", POSITIVE),
    }

    dof: int | tuple[int, int] | None = 0
    stiffness: float = 1.0
    gap: float = 0.1

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.unit("stiffness", gap=f * seen.x_rms) for f in (0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.4)]

    def law(self, at: At, p):
        return -p.stiffness * ca.fmin(ca.fmax(at.x, -p.gap), p.gap), []
