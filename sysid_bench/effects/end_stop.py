"""Contact at the end of the travel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import NOT_NEGATIVE, POSITIVE, At, Effect, Knob, Seen, Suspect


@dataclass(frozen=True)
class EndStop(Effect):
    """stiffness * (|x| - gap) * sign(x) + damping * v beyond the gap, never pulling; side 1: x > 0 only, -1: x < 0 only, 0: both"""

    name: ClassVar[str] = "end_stop"
    equation: ClassVar[str] = "stiffness * (|x| - gap) * sign(x) + damping * v beyond the gap, never pulling"
    reveals: ClassVar[str] = "an amplitude that reaches the stop often, on both sides"
    held: ClassVar[tuple[str, ...]] = ("side",)
    knobs: ClassVar[dict[str, Knob]] = {
        "stiffness": Knob("N/m", POSITIVE),
        "gap": Knob("m", POSITIVE),
        "damping": Knob("N s/m", NOT_NEGATIVE),
        "side": Knob("1", (-1.0, 1.0)),
    }

    dof: int | tuple[int, int] | None = 0
    stiffness: float = 100.0
    gap: float = 0.1
    damping: float = 0.0
    side: float = 0.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        gaps = [f * seen.x_rms for f in (0.6, 0.85, 1.1, 1.4, 1.7, 2.1)]
        gaps += [f * seen.x_max for f in (0.7, 0.8, 0.88, 0.94)]  # rare hits: near the largest excursion
        return [self.unit("stiffness", gap=g, side=side) for g in gaps for side in (-1.0, 0.0, 1.0)]

    def law(self, at: At, p):
        over, under = ca.fmax(at.x - p.gap, 0), ca.fmin(at.x + p.gap, 0)
        push = ca.if_else(over > 0, ca.fmax(p.stiffness * over + p.damping * at.v, 0), 0)
        pull = ca.if_else(under < 0, ca.fmin(p.stiffness * under + p.damping * at.v, 0), 0)
        return ca.if_else(p.side >= 0, push, 0) + ca.if_else(p.side <= 0, pull, 0), []
