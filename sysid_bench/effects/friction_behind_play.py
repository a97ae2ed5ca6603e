"""Dry friction that a drive reaches through play: after each reversal nothing is transmitted until the gap is crossed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import POSITIVE, At, Effect, Knob, Seen, Suspect


@dataclass(frozen=True)
class FrictionBehindPlay(Effect):
    """stiffness * dead zone of (x - z), half-width gap; z slides where that exceeds force"""

    name: ClassVar[str] = "friction_behind_play"
    states: ClassVar[int] = 1
    equation: ClassVar[str] = "stiffness * dead_zone(x - z, gap), z slides where that exceeds force"
    reveals: ClassVar[str] = "slow reversals at two amplitudes, force and motion both measured"
    knobs: ClassVar[dict[str, Knob]] = {
        "force": Knob("N", POSITIVE),
        "stiffness": Knob("N/m", POSITIVE),
        "gap": Knob("m", POSITIVE),
    }

    dof: int | tuple[int, int] | None = 0
    force: float = 1.0
    stiffness: float = 100.0
    gap: float = 0.01

    def suspects(self, seen: Seen) -> list[Suspect]:
        shares = [(g, s) for g in (0.03, 0.08, 0.16, 0.3) for s in (0.02, 0.08, 0.2)]
        return [self._behind(g * seen.x_rms, s * seen.x_rms) for g, s in shares]

    def _behind(self, gap: float, stretch: float) -> Suspect:
        """A gap, and how far the spring behind it stretches before the friction slides."""
        one = replace(self, force=1.0, stiffness=1.0 / stretch, gap=gap)

        def make(c):
            return replace(one, force=float(c[0]), stiffness=float(c[0]) / stretch) if c[0] > 0 else None

        return Suspect((one,), make)

    def at_rest(self, x):
        return [x]

    def law(self, at: At, p):
        reach = p.gap + p.force / p.stiffness
        z = ca.fmin(ca.fmax(at.z[0], at.x - reach), at.x + reach)
        stretch = at.x - z
        return p.stiffness * (stretch - ca.fmin(ca.fmax(stretch, -p.gap), p.gap)), [z]
