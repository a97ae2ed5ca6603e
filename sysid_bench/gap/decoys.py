"""forces that no catalogue names: they run in the same race, and where one wins the verdict is `unknown`.

A shape in words tells the user what the unexplained force looks like.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from sysid_bench.mechanics.effect import At, Effect, Knob, Seen, Suspect

SHAPES = {
    "v^3": lambda x, v: v**3,
    "x^2 v": lambda x, v: x * x * v,
    "x v": lambda x, v: x * v,
    "v^2": lambda x, v: v * v,
    "x^5": lambda x, v: x**5,
    "|x| v": lambda x, v: ca.fabs(x) * v,
    "x |v|": lambda x, v: x * ca.fabs(v),
    "x v^2": lambda x, v: x * v * v,
    "sqrt|v| sign v": lambda x, v: ca.sign(v) * ca.sqrt(ca.fabs(v) + 1e-300),
}


def _shape(word: str, law) -> type[Effect]:
    @dataclass(frozen=True)
    class Shape(Effect):
        name: ClassVar[str] = f"a force like {word}"
        knobs: ClassVar[dict[str, Knob]] = {"coefficient": Knob("SI")}

        dof: int | tuple[int, int] | None = 0
        coefficient: float = 1.0

        def law(self, at: At, p):
            return p.coefficient * law(at.x, at.v), []

    Shape.__qualname__ = Shape.__name__ = f"Shape[{word}]"
    return Shape


@dataclass(frozen=True)
class LocalDamper(Effect):
    name: ClassVar[str] = "a damper that acts near the middle only"
    knobs: ClassVar[dict[str, Knob]] = {"damping": Knob("N s/m"), "reach": Knob("m", (1e-300, np.inf))}

    dof: int | tuple[int, int] | None = 0
    damping: float = 1.0
    reach: float = 1.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.unit("damping", reach=f * seen.x_rms) for f in (0.4, 0.8)]

    def law(self, at: At, p):
        return p.damping * at.v * ca.exp(-((at.x / p.reach) ** 2)), []


@dataclass(frozen=True)
class LocalSpring(Effect):
    """A pull that is strongest some way off the middle and fades beyond, as a magnet's."""

    name: ClassVar[str] = "a spring that acts near the middle only"
    knobs: ClassVar[dict[str, Knob]] = {"stiffness": Knob("N/m"), "reach": Knob("m", (1e-300, np.inf))}

    dof: int | tuple[int, int] | None = 0
    stiffness: float = 1.0
    reach: float = 1.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.unit("stiffness", reach=f * seen.x_rms) for f in (0.4, 0.8, 1.6)]

    def law(self, at: At, p):
        return p.stiffness * at.x / (1 + (at.x / p.reach) ** 2), []


@dataclass(frozen=True)
class SineOfSpeed(Effect):
    name: ClassVar[str] = "a force that waves with speed"
    knobs: ClassVar[dict[str, Knob]] = {"force": Knob("N"), "speed": Knob("m/s", (1e-300, np.inf))}

    dof: int | tuple[int, int] | None = 0
    force: float = 1.0
    speed: float = 1.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.unit("force", speed=f * seen.v_rms) for f in (0.35, 0.6, 0.9)]

    def law(self, at: At, p):
        return p.force * ca.sin(at.v / p.speed), []


@dataclass(frozen=True)
class ExponentialSpring(Effect):
    name: ClassVar[str] = "a spring that grows exponentially"
    knobs: ClassVar[dict[str, Knob]] = {"force": Knob("N"), "reach": Knob("m")}

    dof: int | tuple[int, int] | None = 0
    force: float = 1.0
    reach: float = 1.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.unit("force", reach=f * seen.x_rms) for f in (0.6, 1.2, -0.6, -1.2)]

    def law(self, at: At, p):
        ratio = ca.fmin(at.x / p.reach, 30)
        return p.force * (ca.exp(ratio) - 1 - ratio), []


@dataclass(frozen=True)
class VaryingDamping(Effect):
    name: ClassVar[str] = "a damping that changes with time"
    knobs: ClassVar[dict[str, Knob]] = {
        "swing": Knob("N s/m"),
        "frequency": Knob("Hz", (1e-300, np.inf)),
        "phase": Knob("rad"),
    }

    dof: int | tuple[int, int] | None = 0
    swing: float = 1.0
    frequency: float = 1.0
    phase: float = 0.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        return [self.wave("swing", "phase", frequency=f) for f in seen.search("damping modulation")]

    def law(self, at: At, p):
        return p.swing * ca.sin(2 * ca.pi * p.frequency * at.t + p.phase) * at.v, []


@dataclass(frozen=True)
class InputPower(Effect):
    """u + gain u^2, a drive that is not linear."""

    name: ClassVar[str] = "a drive whose gain depends on the input"
    path: ClassVar[str] = "actuator"
    knobs: ClassVar[dict[str, Knob]] = {"square": Knob("1/N"), "cube": Knob("1/N^2")}

    dof: int | tuple[int, int] | None = 0
    square: float = 0.0
    cube: float = 0.0

    def suspects(self, seen: Seen) -> list[Suspect]:
        square = InputPower(self.dof, 1.0, 0.0)
        cube = InputPower(self.dof, 0.0, 1.0)
        return [
            Suspect((square,), lambda c: InputPower(self.dof, float(c[0]), 0.0)),
            Suspect((cube,), lambda c: InputPower(self.dof, 0.0, float(c[0]))),
        ]

    def act(self, stages, h, channels, memory):
        stages = np.array(stages)
        u = stages[:, :, channels]
        stages[:, :, channels] = u + self.square * (u * u - np.mean(u * u, axis=(0, 1))) + self.cube * u**3
        return stages, None


DECOYS: tuple[type[Effect], ...] = (
    *(_shape(word, law) for word, law in SHAPES.items()),
    LocalDamper,
    LocalSpring,
    SineOfSpeed,
    ExponentialSpring,
    VaryingDamping,
    InputPower,
)
