"""an effect's name, where and how strong -> the engine's law, and the same numbers in the catalogue's words.

The engine's parameters are chosen apart from the catalogue's; `values` are what an answer is compared with, only
those that mean exactly the same (a smoothing speed does not).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from engine import (
    BOUC_WEN,
    CONSTANT,
    COULOMB,
    CUBIC,
    CUBIC_DAMPING,
    DAHL,
    DRAG,
    EXPONENTIAL,
    GAP,
    LOCAL_DAMPING,
    PLAY,
    PRODUCT,
    RIPPLE,
    ROOT_SPEED,
    SINE_SPEED,
    SLOPE,
    SQUARE,
    SQUARE_SPEED,
    STOP,
    STRIBECK,
    SWING,
    TIMED_DAMPING,
    TONE,
    VAN_DER_POL,
)  # fmt: skip


@dataclass(frozen=True)
class Site:
    """Where an effect acts and how the linear plant moves there: sx, sv rms, top the largest; kc N/m of the place.

    s the drawn strength, size = kc sx N, sign +-1; low, high rad/s of the plant; seconds of a record
    """

    rng: np.random.Generator
    s: float
    sx: float
    sv: float
    top: float
    kc: float
    sign: int
    low: float
    high: float
    seconds: float
    n: int

    @property
    def size(self) -> float:
        return self.kc * self.sx


@dataclass(frozen=True)
class Law:
    """kind and p of the engine; values by the catalogue's parameter names, SI."""

    kind: int
    p: tuple[float, ...]
    values: dict[str, float]


def coulomb_friction(a: Site) -> Law:
    force = 0.7 * a.s * a.size
    speed = a.rng.uniform(0.002, 0.01) * a.sv
    return Law(COULOMB, (force, speed), {"force": force, "speed": speed})


def stribeck_friction(a: Site) -> Law:
    force, excess = 0.4 * a.s * a.size, a.s * a.size * a.rng.uniform(0.4, 1)
    speed = a.sv * a.rng.uniform(0.1, 0.4)
    values = {"force": force, "static_force": force + excess, "stribeck_speed": speed, "speed": 0.005 * a.sv}
    return Law(STRIBECK, (force, excess, speed, 0.005 * a.sv), values)


def presliding_friction(a: Site) -> Law:
    F, reach = 0.7 * a.s * a.size, a.rng.uniform(0.08, 0.4) * a.sx
    return Law(DAHL, (F / reach, reach), {"force": F, "stiffness": F / reach})


def quadratic_drag(a: Site) -> Law:
    c = 0.5 * a.s * a.size / a.sv**2
    return Law(DRAG, (c,), {"coefficient": c})


def cubic_stiffness(a: Site) -> Law:
    k = a.rng.choice([1, 1, 1, -0.15]) * 0.4 * a.s * a.size / a.sx**3
    return Law(CUBIC, (k,), {"stiffness": k})


def quadratic_stiffness(a: Site) -> Law:
    k = a.sign * 0.25 * a.s * a.size / a.sx**2
    return Law(SQUARE, (k,), {"stiffness": k})


def dead_zone(a: Site) -> Law:
    k, gap = a.kc * (a.rng.uniform(0.4, 0.9) if a.n > 1 else 0.95), a.sx * a.rng.uniform(0.2, 0.8)
    return Law(GAP, (k, gap), {"stiffness": k, "gap": gap})


def backlash(a: Site) -> Law:
    k, gap = a.kc * a.rng.uniform(0.4, 0.9), a.sx * a.rng.uniform(0.15, 0.6)
    return Law(PLAY, (k, gap), {"stiffness": k, "gap": gap})


def bouc_wen_hysteresis(a: Site) -> Law:
    e, reach, share = a.rng.choice([1, 2]), a.sx * a.rng.uniform(0.3, 1.2), a.rng.uniform(0.5, 0.9)
    k = a.kc * a.rng.uniform(0.2, 0.7)
    values = {"stiffness": k, "yield_displacement": reach, "exponent": float(e), "shape": share}
    return Law(BOUC_WEN, (k, share / reach**e, (1 - share) / reach**e, e), values)


def end_stop(a: Site) -> Law:
    k, gap, side = a.kc * a.rng.uniform(3, 15), a.rng.uniform(0.45, 0.8) * a.top, a.rng.choice([-1, 0, 1])
    damping = a.rng.choice([0, 0.1]) * a.kc / a.high
    values = {"stiffness": k, "gap": gap, "side": float(side), "damping": damping}
    return Law(STOP, (k, gap, side, damping), values)


def position_ripple(a: Site) -> Law:
    size, k = 0.5 * a.s * a.size, 2 * np.pi / (a.sx * a.rng.uniform(0.6, 2.2))
    phase = a.rng.uniform(0, 6.28)
    values = {"amplitude": size, "pitch": 2 * np.pi / k, "phase": phase - np.pi / 2}
    return Law(RIPPLE, (size, k, phase), values)


def time_varying_stiffness(a: Site) -> Law:
    if a.rng.random() < 0.5:
        slope = a.sign * 0.6 * a.s * a.kc / a.seconds
        return Law(SLOPE, (slope,), {"slope": slope})
    size, w = 0.5 * a.s * a.kc, a.rng.uniform(0.02, 1.0) * a.low
    phase = a.rng.uniform(0, 6.28)
    values = {"amplitude": size, "frequency": w / (2 * np.pi), "phase": phase + np.pi / 2}
    return Law(SWING, (size, w, phase), values)


def periodic_disturbance(a: Site) -> Law:
    w = a.rng.uniform(0.4, 1.4) * a.low if a.n == 1 else a.rng.uniform(0.5 * a.low, a.high)
    size, phase = a.s * a.size, a.rng.uniform(0, 6.28)
    values = {"amplitude": size, "frequency": w / (2 * np.pi), "phase": phase - np.pi / 2}
    return Law(TONE, (size, w, phase), values)


def constant_force(a: Site) -> Law:
    size = a.sign * a.s * a.size
    return Law(CONSTANT, (size,), {"force": -size})


FORCES: dict[str, Callable[[Site], Law]] = {
    f.__name__: f
    for f in (
        coulomb_friction, stribeck_friction, presliding_friction, quadratic_drag, cubic_stiffness, quadratic_stiffness,
        dead_zone, backlash, bouc_wen_hysteresis, end_stop, position_ripple, time_varying_stiffness,
        periodic_disturbance, constant_force,
    )
}  # fmt: skip


def unnamed(name: str, a: Site) -> Law:
    """A force that no catalogue names."""
    s, size, sx, sv = a.s, a.size, a.sx, a.sv
    kind, *p = {
        "cubic_damping": (CUBIC_DAMPING, 0.4 * s * size / sv**3),
        "van_der_pol": (VAN_DER_POL, s * size / sv / sx**2),
        "square_speed": (SQUARE_SPEED, 0.4 * s * size / sv**2),
        "exponential": (EXPONENTIAL, 0.5 * s * size, 0.7 * sx),
        "local_damping": (LOCAL_DAMPING, 2 * s * size / sv, 0.6 * sx),
        "timed_damping": (TIMED_DAMPING, 0.6 * s * size / sv, a.rng.uniform(0.02, 0.6) * a.low),
        "root_speed": (ROOT_SPEED, 0.7 * s * size / np.sqrt(sv)),
        "sine_speed": (SINE_SPEED, 0.6 * s * size, 0.6 * sv),
        "product": (PRODUCT, s * size / sx / sv),
    }[name]
    return Law(kind, tuple(p), {})


def on_the_input(name: str, u: np.ndarray, h: float, high: float, rng) -> tuple[str, float]:
    """(the catalogue's parameter, its value) of an actuator effect on input u (N,)."""
    fastest = np.abs(np.diff(u)).max() / h
    return {
        "saturation": ("limit", np.abs(u).max() * rng.uniform(0.4, 0.75)),
        "input_delay": ("delay", h * rng.uniform(0.6, 6)),
        "actuator_lag": ("time_constant", rng.uniform(0.05, 0.35) / high),
        "input_dead_band": ("width", u.std() * rng.uniform(0.3, 0.8)),
        "rate_limit": ("rate", fastest * rng.uniform(0.2, 0.45)),
    }[name]


def on_the_sensor(name: str, y: np.ndarray, sign: int, rng) -> tuple[str, float]:
    """(the catalogue's parameter, its value) of a sensor effect on output y (N,); a drift is over the whole record."""
    return {
        "sensor_bias": ("bias", sign * y.std() * rng.uniform(0.1, 0.6)),
        "sensor_drift": ("rate", sign * y.std() * rng.uniform(0.3, 1)),
        "quantisation": ("step", y.std() * rng.uniform(0.1, 0.6)),
        "sensor_clipping": ("limit", np.abs(y).max() * rng.uniform(0.4, 0.7)),
    }[name]


def plain(values: dict[str, Any]) -> dict[str, float]:
    return {key: float(x) for key, x in values.items()}
