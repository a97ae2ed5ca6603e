"""Play in a drive: after each reversal the spring lags behind by the gap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import POSITIVE, At, Effect, Knob, Seen, Suspect


@dataclass(frozen=True)
class Backlash(Effect):
    """-stiffness * (x - z), z the play operator of half-width gap"""

    name: ClassVar[str] = "backlash"
    states: ClassVar[int] = 1
    equation: ClassVar[str] = "-stiffness * (x - z), z the play operator of half-width gap"
    reveals: ClassVar[str] = "slow reversals at two amplitudes"
    knobs: ClassVar[dict[str, Knob]] = {
        "stiffness": Knob("N/m", POSITIVE),
        "gap": Knob("m", POSITIVE),
    }

    dof: int | tuple[int, int] | None = 0
    stiffness: float = 1.0
    gap: float = 0.1

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.unit("stiffness", gap=f * seen.x_rms) for f in (0.1, 0.2, 0.35, 0.5, 0.75, 1.0)]

    def at_rest(self, x):
        return [x]

    def law(self, at: At, p):
        z = ca.fmin(ca.fmax(at.z[0], at.x - p.gap), at.x + p.gap)
        return -p.stiffness * (at.x - z), [z]
