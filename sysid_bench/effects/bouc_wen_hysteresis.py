"""Hysteretic spring with smooth yielding (Bouc 1967, Wen 1976)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from sysid_bench.mechanics.effect import POSITIVE, At, Effect, Knob, Seen, Suspect


def _slope(z, dx, p):
    share = (ca.fabs(z) / p.yield_displacement + 1e-12) ** p.exponent
    return 1 - (p.shape * ca.sign(dx * z) + 1 - p.shape) * share


@dataclass(frozen=True)
class BoucWenHysteresis(Effect):
    """stiffness * z, dz/dx = 1 - (shape sign(v z) + 1 - shape) |z / yield_displacement|^exponent"""

    name: ClassVar[str] = "bouc_wen_hysteresis"
    states: ClassVar[int] = 1
    equation: ClassVar[str] = (
        "stiffness * z, dz/dx = 1 - (shape sign(v z) + 1 - shape) |z / yield_displacement|^exponent"
    )
    reveals: ClassVar[str] = "nested loops at several rates"
    held: ClassVar[tuple[str, ...]] = ("exponent",)
    knobs: ClassVar[dict[str, Knob]] = {
        "stiffness": Knob("N/m", POSITIVE),
        "yield_displacement": Knob("m", POSITIVE),
        "exponent": Knob("1", POSITIVE),
        "shape": Knob("1", (0.0, 1.0)),
    }

    dof: int | tuple[int, int] | None = 0
    stiffness: float = 1.0
    yield_displacement: float = 0.1
    exponent: float = 1.0
    shape: float = 0.5

    def suspects(self, seen: Seen) -> list[Suspect]:
        grid = [(f, e) for f in (0.15, 0.3, 0.6, 1.0, 1.6) for e in (1.0, 2.0)]
        return [self.unit("stiffness", yield_displacement=f * seen.x_rms, exponent=e) for f, e in grid]

    def law(self, at: At, p):
        dx = at.x - at.x_before
        z = at.z[0]
        half = z + 0.5 * dx * _slope(z, dx, p)  # explicit midpoint in x: the law does not know time
        z = z + dx * _slope(half, dx, p)
        z = ca.fmin(ca.fmax(z, -p.yield_displacement), p.yield_displacement)
        return p.stiffness * z, [z]
