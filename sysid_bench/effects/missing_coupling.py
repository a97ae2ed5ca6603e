"""Spring and damper between two DOFs that the model leaves out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid_bench.mechanics.effect import Effect, Knob


@dataclass(frozen=True)
class MissingCoupling(Effect):
    """stiffness * x + damping * v between two DOFs"""

    name: ClassVar[str] = "missing_coupling"
    path: ClassVar[str] = "structure"
    equation: ClassVar[str] = "stiffness * x + damping * v between two DOFs"
    reveals: ClassVar[str] = "sensors on both DOFs, one driven"
    knobs: ClassVar[dict[str, Knob]] = {
        "stiffness": Knob("N/m"),
        "damping": Knob("N s/m"),
    }

    dof: int | tuple[int, int] | None = (0, 1)
    stiffness: float = 1.0
    damping: float = 0.0

    def augment(self, M, D, K, c):
        """M, D, K with the coupling built in; c (n,) the direction of the place."""
        both = np.outer(c, c)
        return M, D + self.damping * both, K + self.stiffness * both
