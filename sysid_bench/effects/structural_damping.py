"""Loss per cycle that does not depend on frequency (hysteretic damping k(1 + i eta))."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from sysid_bench.mechanics.effect import POSITIVE, At, Effect, Knob, Seen, Suspect

# A sum of relaxations at log-spaced rates: sum of w s / (s + r) has a flat loss of (pi / 2) w / ln(spacing).
RATES = [float(r) for r in np.geomspace(1e-2, 1e2, 9)]
WEIGHT = float(np.log(RATES[1] / RATES[0]) * 2 / np.pi)


@dataclass(frozen=True)
class StructuralDamping(Effect):
    """stiffness * H x, |Im H| = 1 from a hundredth to a hundred times `frequency`"""

    name: ClassVar[str] = "structural_damping"
    states: ClassVar[int] = 9
    equation: ClassVar[str] = "stiffness * H x, |Im H| = 1 from a hundredth to a hundred times `frequency`"
    reveals: ClassVar[str] = "two frequencies at equal amplitude"
    held: ClassVar[tuple[str, ...]] = ("frequency",)
    knobs: ClassVar[dict[str, Knob]] = {
        "stiffness": Knob("N/m", POSITIVE),
        "frequency": Knob("Hz", POSITIVE),
    }

    dof: int | tuple[int, int] | None = 0
    stiffness: float = 1.0
    frequency: float = 1.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        middle = (seen.omega_low * seen.omega_high) ** 0.5 / (2 * np.pi)
        return [self.unit("stiffness", frequency=float(middle))]

    def at_rest(self, x):
        return [x] * self.states

    def law(self, at: At, p):
        total, following = 0.0, []
        for ratio, z in zip(RATES, at.z):
            rate = 2 * ca.pi * p.frequency * ratio
            keep = ca.exp(-rate * at.h)
            mean = (1 - keep) / (rate * at.h)  # the input runs linearly inside the step: exact response
            after = keep * z + (mean - keep) * at.x_before + (1 - mean) * at.x
            following.append(after)
            total = total + (at.x - after)
        return p.stiffness * WEIGHT * total, following
