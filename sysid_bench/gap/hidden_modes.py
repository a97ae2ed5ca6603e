"""motion seen -> hidden masses that may ride on it, over a grid of frequencies and damping ratios: once for all places."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid_bench.gap.columns import mode_responses
from sysid_bench.gap.motion import Seen
from sysid_bench.gap.problem import Problem, frequency_range
from sysid_bench.nouns import Array


@dataclass(frozen=True, eq=False)
class Modes:
    """Hidden masses of 1 kg: w0 rad/s, zeta (m,), per trace the responses (m, F) to a displacement of what carries them."""

    kind: Any
    w0: Array
    zeta: Array
    responses: list[np.ndarray]

    def maker(self, place: int, k: int):
        """What makes the effect at a place of the fitted mass."""
        hertz, zeta = float(self.w0[k] / (2 * np.pi)), float(self.zeta[k])
        return lambda c: (
            self.kind(dof=place, mass=float(c[0]), frequency=hertz, damping_ratio=zeta) if c[0] > 0 else None
        )


def hidden_modes(problem: Problem, seens: list[Seen], catalogue) -> Modes | None:
    """One more mode at a DOF, over a grid finer than the modes are wide; None where the catalogue has none."""
    kind = next((k for k in catalogue if k.name == "extra_mode"), None)
    if kind is None:
        return None
    low, high = frequency_range(problem.model, seens[0].trace)
    grid = [
        (w, zeta)
        for zeta, spacing in ((0.02, 1.035), (0.08, 1.1))
        for w in np.exp(np.arange(np.log(max(0.4 * low, 0.02 * high)), np.log(2.2 * high), np.log(spacing)))
    ]
    w0, zeta = np.array(grid).T
    return Modes(kind, w0, zeta, [mode_responses(s.trace, w0, zeta) for s in seens])
