"""The input arrives later."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid_bench.mechanics.effect import NOT_NEGATIVE, Effect, Knob, Seen, Suspect


def _between(later, newer, share):
    """Small steps delayed by a share of a step. Held inputs keep their mean, running ones are read on their curve."""
    if np.array_equal(newer[:, 0], newer[:, 2]) and np.array_equal(later[:, 0], later[:, 2]):
        return share * later + (1 - share) * newer
    times = np.array([0.0, 0.5, 1.0]) - share
    parts = [_quadratic(later, t + 1) if t < 0 else _quadratic(newer, t) for t in times]
    return np.stack(parts, axis=1)


def _quadratic(stages, t):
    start, middle, end = stages[:, 0], stages[:, 1], stages[:, 2]
    return start * (1 - t) * (1 - 2 * t) + middle * 4 * t * (1 - t) + end * t * (2 * t - 1)


@dataclass(frozen=True)
class InputDelay(Effect):
    """u(t - delay)"""

    name: ClassVar[str] = "input_delay"
    path: ClassVar[str] = "actuator"
    equation: ClassVar[str] = "u(t - delay)"
    reveals: ClassVar[str] = "a wide band, up to a quarter of the inverse delay"
    knobs: ClassVar[dict[str, Knob]] = {
        "delay": Knob("s", NOT_NEGATIVE),
    }

    dof: int | tuple[int, int] | None = 0
    delay: float = 0.01

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.changed("delay", f * seen.h) for f in (0.3, 0.7, 1.5, 3.0, 6.0)]

    def act(self, stages, h, channels, memory):
        """Stage values (S, 3, nu) -> the same, later; memory (m, 2, nu): what is still under way."""
        stages, part = np.array(stages), stages[:, :, channels]
        m = int(np.ceil(self.delay / h)) + 1
        past = np.zeros((m, 3, len(channels))) if memory is None else memory
        line = np.concatenate([past, part])
        whole = int(np.floor(self.delay / h))
        share = self.delay / h - whole
        later, newer = line[m - whole - 1 : len(line) - whole - 1], line[m - whole : len(line) - whole]
        stages[:, :, channels] = _between(later, newer, share)
        return stages, line[len(line) - m :]
