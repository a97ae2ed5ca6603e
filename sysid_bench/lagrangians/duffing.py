"""A mass on a hardening spring: q (1,) displacement, m; u force, N."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Duffing:
    """L = m v^2 / 2 - k q^2 / 2 - k3 q^4 / 4, force u - c v."""

    mass_kg: float = 1.0
    damping_N_s_m: float = 0.1
    stiffness_N_m: float = 1.0
    cubic_stiffness_N_m3: float = 0.5

    n = 1
    nu = 1

    def values(self) -> Mapping[str, float]:
        return asdict(self)

    def lagrangian(self, q: Any, v: Any, p: Mapping[str, Any]) -> Any:
        spring = p["stiffness_N_m"] * q[0] ** 2 / 2 + p["cubic_stiffness_N_m3"] * q[0] ** 4 / 4
        return p["mass_kg"] * v[0] ** 2 / 2 - spring

    def force(self, q: Any, v: Any, u: Any, p: Mapping[str, Any]) -> Any:
        return u - p["damping_N_s_m"] * v
