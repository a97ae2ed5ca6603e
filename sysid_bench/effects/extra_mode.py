"""A mass on a spring that the model does not know of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid_bench.mechanics.effect import NOT_NEGATIVE, POSITIVE, Effect, Knob


@dataclass(frozen=True)
class ExtraMode(Effect):
    """a hidden mass on a spring at the place, resonant at frequency"""

    name: ClassVar[str] = "extra_mode"
    path: ClassVar[str] = "structure"
    equation: ClassVar[str] = "a hidden mass on a spring at the place, resonant at frequency"
    reveals: ClassVar[str] = "a slow sweep through the frequency, at two places"
    knobs: ClassVar[dict[str, Knob]] = {
        "mass": Knob("kg", POSITIVE),
        "frequency": Knob("Hz", POSITIVE),
        "damping_ratio": Knob("1", NOT_NEGATIVE),
    }

    dof: int | tuple[int, int] | None = 0
    mass: float = 0.1
    frequency: float = 1.0
    damping_ratio: float = 0.05

    def augment(self, M, D, K, c):
        """M, D, K with one more DOF; c (n,) the direction of the place."""
        omega = 2 * np.pi * self.frequency
        link = np.append(c, -1.0)
        grown = [np.pad(X, ((0, 1), (0, 1))) for X in (M, D, K)]
        grown[0][-1, -1] = self.mass
        both = np.outer(link, link)
        return (
            grown[0],
            grown[1] + 2 * self.damping_ratio * omega * self.mass * both,
            grown[2] + omega**2 * self.mass * both,
        )
