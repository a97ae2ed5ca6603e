"""Two masses on two rigid rods: q (2,) absolute angles from hanging, rad; u torques on the rods, N m."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import casadi as ca


@dataclass(frozen=True)
class DoublePendulum:
    """Point masses at the rods' ends, viscous damping in both joints (of the second on the relative rate)."""

    mass_1_kg: float = 1.0
    mass_2_kg: float = 0.5
    length_1_m: float = 1.0
    length_2_m: float = 0.7
    damping_1_N_m_s: float = 0.05
    damping_2_N_m_s: float = 0.02
    gravity_m_s2: float = 9.81

    n = 2
    nu = 2

    def values(self) -> Mapping[str, float]:
        return asdict(self)

    def lagrangian(self, q: Any, v: Any, p: Mapping[str, Any]) -> Any:
        m1, m2, l1, l2 = (p[k] for k in ("mass_1_kg", "mass_2_kg", "length_1_m", "length_2_m"))
        kinetic = (m1 + m2) * (l1 * v[0]) ** 2 / 2 + m2 * (l2 * v[1]) ** 2 / 2
        kinetic = kinetic + m2 * l1 * l2 * v[0] * v[1] * ca.cos(q[0] - q[1])
        return kinetic + p["gravity_m_s2"] * ((m1 + m2) * l1 * ca.cos(q[0]) + m2 * l2 * ca.cos(q[1]))

    def force(self, q: Any, v: Any, u: Any, p: Mapping[str, Any]) -> Any:
        between = p["damping_2_N_m_s"] * (v[1] - v[0])
        return u + ca.vertcat(-p["damping_1_N_m_s"] * v[0] + between, -between)
