"""A model (what a method is handed), and the promise of the effects that it may hold."""

# None for n and the maps asks for what the matrices say; the types are those that stand there afterwards.
# pyright: reportUnnecessaryComparison=false

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from sysid_bench.nouns.words import HOLDS, OUTPUTS, Array, Hold, InputError, Output, frozen_array

MATRICES = ("mass", "damping", "stiffness")


class Effect(Protocol):
    """One term of the equation of motion, of the actuator path or of the sensor path.

    The base class of all is mechanics.effect.Effect; `effects.effect(name, dof, parameters)` makes one.
    dof: 0-based degree of freedom, a pair (i, j) for something between two (x = q_i - q_j), None: everywhere.
    """

    name: ClassVar[str]
    path: ClassVar[str]  # force, structure, actuator, sensor or timing

    @property
    def dof(self) -> int | tuple[int, int] | None: ...

    def as_dict(self) -> dict[str, Any]:
        """Entry of a model file: {"name", "dof", "parameters": {name: {"value", "unit"}}}."""
        ...


@dataclass(frozen=True, eq=False)
class Model:
    """What a method or the gap workflow is handed: structure, nominal values, which entries are free.

    mass, damping, stiffness  (n, n) symmetric, SI; None where nothing nominal is known (all or none)
    n                         degrees of freedom; taken from the matrices where given
    input_map                 L (n, nu): forces on the DOFs; identity where None
    output_map                C (ny, n): which combinations of the DOFs are measured; identity where None
    output                    what is measured: displacement, velocity or acceleration
    hold                      how the input runs between samples; None: take the record's
    initial_state             "free": q and q' at the first sample unknown; "at_rest": velocity zero,
                              displacement the static equilibrium
    free                      {"mass" | "damping" | "stiffness": (n, n) bool}: entries to be estimated;
                              a missing key means all. Entries that are not free keep their nominal value
    effects                   nonlinear and path effects, tuple of Effect
    units                     checked against the record where present
    sample_time_s             checked against the record where present
    """

    mass: Array | None = None
    damping: Array | None = None
    stiffness: Array | None = None
    n: int = None  # type: ignore[assignment]
    input_map: Array = None  # type: ignore[assignment]  # the identity, set below
    output_map: Array = None  # type: ignore[assignment]
    output: Output = "displacement"
    hold: Hold | None = None
    initial_state: Literal["free", "at_rest"] = "free"
    free: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict[str, NDArray[np.bool_]])
    effects: tuple[Effect, ...] = ()
    units: Mapping[str, Any] = field(default_factory=dict[str, Any])
    sample_time_s: float | None = None

    def __post_init__(self) -> None:
        n = self.n
        values = [getattr(self, name) for name in MATRICES]
        if any(x is not None for x in values):
            if any(x is None for x in values):
                raise InputError("mass, damping and stiffness must be given together, or none of them.")
            n = len(frozen_array(self.mass, "mass", 2))
            for name, value in zip(MATRICES, values):
                object.__setattr__(self, name, _square(value, name, n))
            smallest = np.linalg.eigvalsh(self.matrices[0])[0]
            if smallest <= 0:
                raise InputError(f"mass must be positive definite; its smallest eigenvalue is {smallest:g}.")
        if n is None or n < 1:
            raise InputError("a model needs its number of degrees of freedom: give n, or the matrices.")
        if self.n is not None and self.n != n:
            raise InputError(f"n = {self.n} contradicts the {n}x{n} mass matrix.")
        object.__setattr__(self, "n", n)
        for name, value in _maps(self.input_map, self.output_map, n).items():
            object.__setattr__(self, name, value)
        self._refuse_other_words()
        free = {name: _mask(name, mask, n) for name, mask in self.free.items()}
        object.__setattr__(self, "free", free)
        object.__setattr__(self, "effects", _effects(self.effects))

    def _refuse_other_words(self) -> None:
        if self.output not in OUTPUTS:
            raise InputError(f"output must be one of {', '.join(OUTPUTS)}; got {self.output!r}.")
        if self.hold is not None and self.hold not in HOLDS:
            raise InputError(f"hold must be one of {', '.join(HOLDS)}; got {self.hold!r}.")
        if self.initial_state not in ("free", "at_rest"):
            raise InputError(f"initial_state must be free or at_rest; got {self.initial_state!r}.")

    @property
    def nu(self) -> int:
        return self.input_map.shape[1]

    @property
    def ny(self) -> int:
        return self.output_map.shape[0]

    @property
    def has_values(self) -> bool:
        return self.mass is not None

    @property
    def matrices(self) -> tuple[Array, Array, Array]:
        """mass, damping, stiffness (n, n). Raises InputError for a model without values."""
        if self.mass is None or self.damping is None or self.stiffness is None:
            raise InputError("this needs values of mass, damping and stiffness; the model has no values.")
        return self.mass, self.damping, self.stiffness

    @property
    def fully_sensed_and_actuated(self) -> bool:
        """True where every DOF has its own sensor and its own force (both maps the identity)."""
        eye = np.eye(self.n)
        return np.array_equal(self.input_map, eye) and np.array_equal(self.output_map, eye)

    def structure_only(self) -> Model:
        """The same model without values or effects: all that a black-box method may know."""
        return replace(self, mass=None, damping=None, stiffness=None, free={}, effects=())


def _maps(inputs: Any, outputs: Any, n: int) -> dict[str, Array]:
    """input_map (n, nu) and output_map (ny, n), the identity where None."""
    L = frozen_array(np.eye(n) if inputs is None else inputs, "input_map", 2)
    C = frozen_array(np.eye(n) if outputs is None else outputs, "output_map", 2)
    if L.shape[0] != n:
        raise InputError(f"input_map must have {n} rows, one per degree of freedom; got shape {L.shape}.")
    if C.shape[1] != n:
        raise InputError(f"output_map must have {n} columns, one per degree of freedom; got shape {C.shape}.")
    return {"input_map": L, "output_map": C}


def _mask(name: str, value: Any, n: int) -> NDArray[np.bool_]:
    mask = np.array(value, dtype=bool)
    if name not in MATRICES or mask.shape != (n, n) or (mask != mask.T).any():
        raise InputError(
            f"free.{name} must be a symmetric {n}x{n} mask of mass, damping or stiffness; got {mask.shape}."
        )
    return mask


def _square(value: Any, name: str, n: int) -> Array:
    matrix = frozen_array(value, name, 2)
    if matrix.shape != (n, n):
        raise InputError(f"{name} must be square, shape ({n}, {n}); got {matrix.shape}.")
    if not np.all(np.isfinite(matrix)):
        raise InputError(f"{name} has an entry that is not finite.")
    if not np.allclose(matrix, matrix.T, rtol=1e-9, atol=1e-12 * np.abs(matrix).max(initial=0)):
        i, j = np.unravel_index(np.argmax(np.abs(matrix - matrix.T)), matrix.shape)
        raise InputError(
            f"{name} must be symmetric; entry [{i}][{j}] is {matrix[i, j]:g} and [{j}][{i}] is {matrix[j, i]:g}."
        )
    return matrix


def _effects(values: Any) -> tuple[Effect, ...]:
    for value in values:
        if not isinstance(getattr(value, "name", None), str):
            raise InputError(f"effects must be a list of options of the group effect; got {value!r:.60}.")
    return tuple(values)
