"""A mass on a rigid rod: q (1,) angle from hanging, rad; u torque, N m."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import casadi as ca


@dataclass(frozen=True)
class Pendulum:
    """L = m l^2 v^2 / 2 + m g l cos q, torque u - c v. From free swings only c / (m l^2) and g / l show."""

    mass_kg: float = 1.0
    length_m: float = 1.0
    damping_N_m_s: float = 0.05
    gravity_m_s2: float = 9.81

    n = 1
    nu = 1

    def values(self) -> Mapping[str, float]:
        return asdict(self)

    def lagrangian(self, q: Any, v: Any, p: Mapping[str, Any]) -> Any:
        inertia = p["mass_kg"] * p["length_m"] ** 2
        return inertia * v[0] ** 2 / 2 + p["mass_kg"] * p["gravity_m_s2"] * p["length_m"] * ca.cos(q[0])

    def force(self, q: Any, v: Any, u: Any, p: Mapping[str, Any]) -> Any:
        return u - p["damping_N_m_s"] * v
