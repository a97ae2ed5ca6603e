"""What every effect is: a name, a place, parameters with unit and admissible range, and its law.

An effect file holds one frozen dataclass: its fields are `dof` and its parameters, plain numbers with defaults.
    path "force"     a force on one DOF, or between two: law(at, p) -> (force, next states), a CasADi expression.
                     The equation of motion is  M q'' + D q' + K q + c force = L u,  x = c' q,  v = c' q'
    path "structure" changes M, D, K themselves: augment(M, D, K, c) -> M, D, K (may add hidden DOFs)
    path "actuator"  act(stages, h, memory) -> (stages, memory): what the input becomes on its way
    path "sensor", "timing"   sense(y, t) -> y: what the measurement becomes on its way
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from sysid_bench.nouns import Array, InputError

ANY, POSITIVE, NOT_NEGATIVE = (-np.inf, np.inf), (1e-300, np.inf), (0.0, np.inf)
# Inputs of a law, before its states and parameters; see At.
HEAD = ("x", "v", "t", "h", "x_before", "mobility")


@dataclass(frozen=True)
class At:
    """What a law sees at the end of one small step of h seconds, all scalars (CasADi symbols).

    x, v      displacement and velocity of the place, m and m/s; x_before: x at the start of the step
    t         time, s
    mobility  velocity that a force of 1 N at the place gains in this step, m/(s N)
    z         internal states at the start of the step
    """

    x: Any
    v: Any
    t: Any
    h: Any
    x_before: Any
    mobility: Any
    z: tuple[Any, ...]


@dataclass(frozen=True)
class Seen:
    """What a suspect may know of the record at its place: sizes to lay its grid over.

    x_rms, x_max m; v_rms m/s; u_rms, u_max, u_step N (step: largest change between samples);
    h, duration s; omega_low, omega_high rad/s of the plant; search(kind) -> values worth trying:
    "tone" Hz, "modulation" Hz, "pitch" m, found from the unexplained force itself
    """

    x_rms: float
    x_max: float
    v_rms: float
    u_rms: float
    u_max: float
    u_step: float
    h: float
    duration: float
    omega_low: float
    omega_high: float
    search: Callable[[str], list[float]]


@dataclass(frozen=True)
class Suspect:
    """How an effect is suspected: unit forms whose forces are fitted linearly, and what the coefficients mean.

    make(coefficients) -> the effect with these values, None where nature does not allow them.
    """

    columns: tuple[Effect, ...]
    make: Callable[[Array], Effect | None]


@dataclass(frozen=True)
class Knob:
    """Declares a parameter of an effect: its unit and what values nature allows."""

    unit: str
    range: tuple[float, float] = ANY


@dataclass(frozen=True)
class Effect:
    """Base of all effects; subclasses are frozen dataclasses whose fields are dof and the parameters."""

    name: ClassVar[str] = ""
    path: ClassVar[str] = "force"
    knobs: ClassVar[dict[str, Knob]] = {}
    states: ClassVar[int] = 0
    equation: ClassVar[str] = ""
    reveals: ClassVar[str] = ""  # the excitation that shows it
    held: ClassVar[tuple[str, ...]] = ()  # parameters that are chosen, never fitted

    dof: int | tuple[int, int] | None = 0

    def __post_init__(self) -> None:
        dof = self.dof
        if isinstance(dof, (list, tuple)):
            if len(dof) != 2 or dof[0] == dof[1]:
                raise InputError(f"{self.name}.dof must be one DOF or two different ones; got {list(dof)}.")
            object.__setattr__(self, "dof", (int(dof[0]), int(dof[1])))
        for key, knob in self.knobs.items():
            value, (low, high) = getattr(self, key), knob.range
            if isinstance(value, str):
                continue
            if not (low <= value <= high and abs(value) < np.inf):
                raise InputError(
                    f"{self.name}.{key} must lie in [{low:g}, {high:g}] {knob.unit}; got {value!r}."
                )

    @property
    def values(self) -> Array:
        """(np,) numeric parameters in the order of `knobs`."""
        return np.array([float(getattr(self, key)) for key in self.numeric])

    @cached_property
    def numeric(self) -> tuple[str, ...]:
        """Names of the parameters that are numbers."""
        return tuple([key for key in self.knobs if not isinstance(getattr(self, key), str)])

    def value(self, key: str) -> float:
        """One numeric parameter."""
        return float(getattr(self, key))

    def with_values(self, values: Array) -> Effect:
        """The same effect with other numbers, moved into their admissible ranges."""
        kept = {}
        for key, value in zip(self.numeric, values):
            low, high = self.knobs[key].range
            kept[key] = float(min(max(value, low), high))
        return dataclasses.replace(self, **kept)

    def as_dict(self) -> dict[str, Any]:
        """The entry of a model file: name, dof, parameters with value and unit."""
        parameters = {key: {"value": getattr(self, key), "unit": k.unit} for key, k in self.knobs.items()}
        dof = list(self.dof) if isinstance(self.dof, tuple) else self.dof
        return {"name": self.name, "dof": dof, "parameters": parameters}

    def at_rest(self, x: float) -> list[float]:
        """Internal states when the place rests at x."""
        return [0.0] * self.states

    def unit(self, key: str, **shape: float) -> Suspect:
        """Suspect whose force is linear in one parameter; the others are fixed by `shape`."""
        one = dataclasses.replace(self, **{key: 1.0}, **shape)
        low, high = self.knobs[key].range

        def make(c: Array) -> Effect | None:
            return dataclasses.replace(one, **{key: float(c[0])}) if low <= c[0] <= high else None

        return Suspect((one,), make)

    def changed(self, key: str, value: float, **shape: float) -> Suspect:
        """Suspect of the actuator path: what it changes, at one value, must come out about once."""
        one = dataclasses.replace(self, **{key: value}, **shape)
        return Suspect((one,), lambda c: one if 0.3 < c[0] < 3.0 else None)

    def wave(self, amplitude: str, phase: str, **shape: float) -> Suspect:
        """Suspect of a sine of unknown phase: its two quadratures."""
        quadratures = [
            dataclasses.replace(self, **{amplitude: 1.0, phase: a}, **shape) for a in (0, np.pi / 2)
        ]

        def make(c: Array) -> Effect:
            size, angle = float(np.hypot(c[0], c[1])), float(np.arctan2(c[1], c[0]))
            return dataclasses.replace(quadratures[0], **{amplitude: size, phase: angle})

        return Suspect(tuple(quadratures), make)

    def suspects(self, seen: Seen) -> list[Suspect]:
        """Forms to screen for. A force law without its own grid is tried as it stands, linear in its first parameter."""
        return [self.unit(self.numeric[0])] if self.path == "force" and self.numeric else []

    def law(self, at: At, p: SimpleNamespace) -> tuple[Any, list[Any]]:
        """Force and next states, CasADi expressions. p holds the parameters by name."""
        raise self._lacks("law")

    def augment(self, M: Array, D: Array, K: Array, c: Array) -> tuple[Array, Array, Array]:
        """M, D, K (n', n'), n' >= n: the structure with the effect built in; c (n,) as in `direction`."""
        raise self._lacks("augment")

    def act(self, stages: Array, h: float, channels: list[int], memory: Any) -> tuple[Array, Any]:
        """What the stage values (S, 3, nu) become in `channels`, h s per small step; memory: None at the start."""
        raise self._lacks("act")

    def sense(self, y: Array, t: Array, channels: list[int]) -> Array:
        """What the measurement y (N, ny) at t (N,) s becomes in `channels`."""
        raise self._lacks("sense")

    def _lacks(self, method: str) -> InputError:
        return InputError(f"an effect of path {self.path} needs a method {method}; {self.name} has none.")


def as_effects(terms: Iterable[Any]) -> tuple[Effect, ...]:
    """A model's effects as what can be simulated. Raises InputError for what is no subclass of Effect."""
    found = tuple(terms)
    for term in found:
        if not isinstance(term, Effect):
            raise InputError(
                f"effects must be of subclasses of sysid_bench.mechanics.effect.Effect; got {term!r:.60}."
            )
    return found


def direction(dof: int | tuple[int, int] | None, n: int) -> Array:
    """c (n,): x = c' q is the motion at the place. Raises InputError outside 0..n-1."""
    ends = (0,) if dof is None and n == 1 else (dof if isinstance(dof, tuple) else (dof,))
    if any(not isinstance(i, (int, np.integer)) or not 0 <= i < n for i in ends):
        raise InputError(
            f"an effect's dof must lie in 0..{n - 1} (counted from 0) or be a pair; got {dof!r}."
        )
    c = np.zeros(n)
    c[ends[0]] = 1.0
    if len(ends) == 2:
        c[ends[1]] = -1.0
    return c


@lru_cache(maxsize=256)
def _tapes(kind: type[Effect], layout: tuple[str, ...]):
    import casadi as ca

    from sysid_bench.mechanics.tape import tape

    nz = kind.states
    symbols = ca.SX.sym("in", len(HEAD) + nz + len(layout))
    parts = ca.vertsplit(symbols)
    at = At(*parts[: len(HEAD)], z=tuple(parts[len(HEAD) : len(HEAD) + nz]))
    p = SimpleNamespace(**dict(zip(layout, parts[len(HEAD) + nz :])))
    force, following = kind().law(at, p)
    if len(following) != nz:
        raise InputError(f"{kind.name}.law must return {nz} next state(s); it returned {len(following)}.")
    force = ca.SX(force)
    slopes = ca.densify(ca.jacobian(force, ca.vertcat(at.x, at.v))).T
    value = ca.Function("law", [symbols], [ca.densify(ca.vertcat(force, slopes, *following))])
    rows = ca.vertcat(force, *following)
    jacobian = ca.densify(ca.jacobian(rows, symbols))
    slopes = ca.Function("slopes", [symbols], [ca.reshape(jacobian.T, -1, 1)])
    alone = ca.Function("force", [symbols], [ca.densify(ca.vertcat(force, *following))])
    steady = {HEAD.index("h"), HEAD.index("mobility")}  # and the parameters
    varying = frozenset(range(len(HEAD) + nz)) - steady
    return tape(value, varying), tape(slopes, varying), tape(alone, varying)


def law_tapes(effect: Effect):
    """Tapes of a force effect: [f, df/dx, df/dv, z...]; the Jacobian of [f, z...], row by row; [f, z...] alone."""
    return _tapes(type(effect), effect.numeric)
