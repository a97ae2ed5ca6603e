"""The input runs between its samples otherwise than the model says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from sysid_bench.mechanics.effect import Effect, Knob


@dataclass(frozen=True)
class WrongHold(Effect):
    """u runs as `hold` between samples"""

    name: ClassVar[str] = "wrong_hold"
    path: ClassVar[str] = "actuator"
    equation: ClassVar[str] = "u runs as `hold` between samples"
    reveals: ClassVar[str] = "a band near the Nyquist frequency"
    held: ClassVar[tuple[str, ...]] = ("hold",)
    knobs: ClassVar[dict[str, Knob]] = {
        "hold": Knob("zoh|foh|cubic|bandlimited"),
    }

    dof: int | tuple[int, int] | None = None
    hold: str = "foh"

    def act(self, stages, h, channels, memory):
        """The simulation reads `hold` itself before it builds the stage values: nothing is left to do."""
        return stages, None
