"""READ FIRST: the nouns of the suite and the promises of every shelf.

Shapes: time first, always two-dimensional: t (N,), u (N, nu), y (N, ny), q (N, n). SI units inside.
"""

# None for n and the maps asks for what the matrices say; the types are those that stand there afterwards.
# pyright: reportUnnecessaryComparison=false

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

# Real (float64) and complex (complex128) arrays; each docstring says the shape, numpy's stubs cannot.
Array = np.ndarray[Any, Any]
Complex = np.ndarray[Any, Any]
Hold = Literal["zoh", "foh", "cubic", "bandlimited"]
Output = Literal["displacement", "velocity", "acceleration"]
Status = Literal["ok", "diverged", "timeout", "not_applicable", "error"]

HOLDS: tuple[str, ...] = ("zoh", "foh", "cubic", "bandlimited")
OUTPUTS: tuple[str, ...] = ("displacement", "velocity", "acceleration")
STATUSES: tuple[str, ...] = ("ok", "diverged", "timeout", "not_applicable", "error")

# Bits of Record.quality; 0 is a good sample.
LOST, DUPLICATED, REORDERED, CORRUPTED, LATE, CLIPPED, STUCK = 1, 2, 4, 8, 16, 32, 64
UNIFORM_STEP_RTOL = 1e-6


class InputError(ValueError):
    """The call or its input is wrong: one message (wanted, given, where, way out), exit code 2."""


class NotApplicable(Exception):
    """A method says that this record or model is outside what it can handle, with the reason."""


class Diverged(Exception):
    """A method did not reach a usable estimate, with the reason."""


def frozen_array(value: Any, name: str, ndim: int) -> Array:
    """Read-only float64 copy of `value`; refuses wrong dimension."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as problem:
        raise InputError(f"{name} must be an array of numbers; got {value!r:.80} ({problem}).") from None
    if array.ndim != ndim:
        hint = f" For one channel use {name.split('.')[-1]}[:, None]." if (ndim, array.ndim) == (2, 1) else ""
        raise InputError(f"{name} must have {ndim} dimension(s); got shape {array.shape}.{hint}")
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Record:
    """Sampled input and output of one run, from simulation, a rig or a file; frozen.

    t        (N,)     sample times, s, strictly increasing
    u        (N, nu)  input at the sample times
    y        (N, ny)  output at the sample times
    hold     how u runs between samples; None where the file does not say. zoh: u_k over [t_k, t_k+1);
             foh: straight lines; cubic: the not-a-knot cubic spline through the samples; bandlimited:
             the Fourier series of one period (`period` samples; the whole record where period is None)
    quality  (N,)     bits (LOST, ...) of nouns; 0 = good. None = all good
    period   samples of one period of a periodic excitation, None where there is none
    units    {"t": "s", "u": [nu strings], "y": [ny strings]}, may be empty
    origin   what made it: resolved config, seed, versions, file hash

    Raises InputError on wrong shapes, non-finite good samples, and times that do not increase.
    """

    t: Array
    u: Array
    y: Array
    hold: Hold | None = None
    quality: NDArray[np.uint8] | None = None
    period: int | None = None
    units: Mapping[str, Any] = field(default_factory=dict[str, Any])
    origin: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        t = frozen_array(self.t, "Record.t", 1)
        u, y = frozen_array(self.u, "Record.u", 2), frozen_array(self.y, "Record.y", 2)
        if len(t) < 2:
            raise InputError(f"Record needs at least 2 samples; got {len(t)}.")
        for name, array in (("u", u), ("y", y)):
            if len(array) != len(t):
                raise InputError(f"Record.{name} must have shape ({len(t)}, n{name}); got {array.shape}.")
        if not np.all(np.isfinite(t)) or np.any(np.diff(t) <= 0):
            k = int(np.argmax(~(np.diff(t) > 0)))
            raise InputError(
                f"Record.t must increase strictly; sample {k + 1} has t = {t[k + 1]} after {t[k]}."
            )
        if self.hold is not None and self.hold not in HOLDS:
            raise InputError(f"Record.hold must be one of {', '.join(HOLDS)} or None; got {self.hold!r}.")
        quality = None if self.quality is None else np.array(self.quality, dtype=np.uint8)
        if quality is not None and quality.shape != t.shape:
            raise InputError(f"Record.quality must have shape ({len(t)},); got {quality.shape}.")
        good = slice(None) if quality is None else quality == 0
        for name, array in (("u", u), ("y", y)):
            bad = ~np.isfinite(array[good]).all(axis=1)
            if bad.any():
                k = int(np.flatnonzero(bad)[0])
                raise InputError(
                    f"Record.{name} has a value that is not finite at good sample {k} (t = {t[good][k]} s); "
                    "remove it or flag the sample in the quality column."
                )
        for name, value in (("t", t), ("u", u), ("y", y), ("quality", quality)):
            object.__setattr__(self, name, value)

    @property
    def N(self) -> int:
        return len(self.t)

    @property
    def nu(self) -> int:
        return self.u.shape[1]

    @property
    def ny(self) -> int:
        return self.y.shape[1]

    @property
    def is_uniform(self) -> bool:
        """True where every step equals the mean step to 1e-6 relative."""
        steps = np.diff(self.t)
        return bool(np.all(np.abs(steps - steps.mean()) <= UNIFORM_STEP_RTOL * steps.mean()))

    @property
    def h(self) -> float:
        """Sampling time in s. Raises InputError where the steps are uneven."""
        if not self.is_uniform:
            steps = np.diff(self.t)
            k = int(np.argmax(np.abs(steps - np.median(steps))))
            raise InputError(
                f"a constant sampling time is wanted (to {UNIFORM_STEP_RTOL:g} relative); step {k} is "
                f"{steps[k]:g} s against a median of {np.median(steps):g} s. Resample the record, or use a "
                "method that takes uneven times."
            )
        return float((self.t[-1] - self.t[0]) / (self.N - 1))

    @property
    def all_good(self) -> bool:
        return self.quality is None or not self.quality.any()

    def __repr__(self) -> str:
        step = f"{self.h:g} s" if self.is_uniform else "uneven steps"
        bad = 0 if self.quality is None else int(np.count_nonzero(self.quality))
        flagged = f", {bad} flagged" if bad else ""
        source = self.origin.get("source", "unknown origin")
        return (
            f"Record({self.N} samples at {step}, nu={self.nu}, ny={self.ny}, "
            f"hold={self.hold or 'unknown'}{flagged}, {source})"
        )


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
        given = [x is not None for x in (self.mass, self.damping, self.stiffness)]
        if any(given) and not all(given):
            raise InputError("mass, damping and stiffness must be given together, or none of them.")
        n = self.n
        if all(given):
            n = len(frozen_array(self.mass, "mass", 2))
            for name in ("mass", "damping", "stiffness"):
                object.__setattr__(self, name, _square(getattr(self, name), name, n))
            smallest = np.linalg.eigvalsh(self.matrices[0])[0]
            if smallest <= 0:
                raise InputError(f"mass must be positive definite; its smallest eigenvalue is {smallest:g}.")
        if n is None or n < 1:
            raise InputError("a model needs its number of degrees of freedom: give n, or the matrices.")
        if self.n is not None and self.n != n:
            raise InputError(f"n = {self.n} contradicts the {n}x{n} mass matrix.")
        L = frozen_array(np.eye(n) if self.input_map is None else self.input_map, "input_map", 2)
        C = frozen_array(np.eye(n) if self.output_map is None else self.output_map, "output_map", 2)
        if L.shape[0] != n:
            raise InputError(f"input_map must have {n} rows, one per degree of freedom; got shape {L.shape}.")
        if C.shape[1] != n:
            raise InputError(
                f"output_map must have {n} columns, one per degree of freedom; got shape {C.shape}."
            )
        if self.output not in OUTPUTS:
            raise InputError(f"output must be one of {', '.join(OUTPUTS)}; got {self.output!r}.")
        if self.hold is not None and self.hold not in HOLDS:
            raise InputError(f"hold must be one of {', '.join(HOLDS)}; got {self.hold!r}.")
        if self.initial_state not in ("free", "at_rest"):
            raise InputError(f"initial_state must be free or at_rest; got {self.initial_state!r}.")
        free: dict[str, NDArray[np.bool_]] = {}
        for name, mask in self.free.items():
            mask = np.array(mask, dtype=bool)
            if name not in ("mass", "damping", "stiffness") or mask.shape != (n, n) or (mask != mask.T).any():
                raise InputError(
                    f"free.{name} must be a symmetric {n}x{n} mask of mass, damping or stiffness; got {mask.shape}."
                )
            free[name] = mask
        effects = _effects(self.effects)
        for name, value in (
            ("n", n),
            ("input_map", L),
            ("output_map", C),
            ("free", free),
            ("effects", effects),
        ):
            object.__setattr__(self, name, value)

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


@dataclass(frozen=True, eq=False)
class Plant:
    """The truth of a simulated experiment: M q'' + D q' + K q = L u + effects, y = C q (or q', q'').

    Same fields and units as Model, all values given.
    """

    mass: Array
    damping: Array
    stiffness: Array
    input_map: Array = None  # type: ignore[assignment]  # the identity, set below
    output_map: Array = None  # type: ignore[assignment]
    output: Output = "displacement"
    effects: tuple[Effect, ...] = ()
    units: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        checked = Model(
            self.mass, self.damping, self.stiffness, input_map=self.input_map, output_map=self.output_map,
            output=self.output,
        )  # fmt: skip
        for name in ("mass", "damping", "stiffness", "input_map", "output_map"):
            object.__setattr__(self, name, getattr(checked, name))
        object.__setattr__(self, "effects", _effects(self.effects))

    @property
    def n(self) -> int:
        return len(self.mass)

    @property
    def matrices(self) -> tuple[Array, Array, Array]:
        """mass, damping, stiffness (n, n)."""
        return self.mass, self.damping, self.stiffness

    @property
    def nu(self) -> int:
        return self.input_map.shape[1]

    @property
    def ny(self) -> int:
        return self.output_map.shape[0]

    @property
    def is_linear(self) -> bool:
        return not self.effects

    def model(self) -> Model:
        """The model that says exactly what this plant is (values and effects included)."""
        return Model(
            self.mass, self.damping, self.stiffness, input_map=self.input_map, output_map=self.output_map,
            output=self.output, effects=self.effects, units=self.units,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Signal:
    """Samples of a continuous-time excitation and what it does between them.

    u (N, nu), hold as in Record, period in samples (None: not periodic). For hold "bandlimited",
    `series` is the signal itself: (omega (nl,) rad/s, amplitude (nl, nu) complex) with
    u(t) = Re sum_l amplitude_l exp(i omega_l t).
    """

    u: Array
    hold: Hold
    period: int | None = None
    series: tuple[Array, NDArray[np.complex128]] | None = None


class Excitation(Protocol):
    """A continuous-time input signal, seeded; knows its intersample behaviour."""

    def signal(self, N: int, h: float, nu: int, rng: np.random.Generator) -> Signal: ...


class Noise(Protocol):
    """What the measurement adds to (or does to) the noise-free output."""

    def apply(self, y: Array, h: float, rng: np.random.Generator) -> tuple[Array, Array]:
        """y (N, ny) noise-free -> (measured (N, ny), variance (ny,) of what was added, per channel)."""
        ...


@dataclass(frozen=True)
class Sampling:
    """N samples, h seconds apart."""

    h_s: float = 0.1
    N: int = 6000

    def __post_init__(self) -> None:
        if not (np.isfinite(self.h_s) and self.h_s > 0):
            raise InputError(f"sampling.h_s must be a positive time in s; got {self.h_s!r}.")
        if self.N < 2:
            raise InputError(f"sampling.N must be at least 2 samples; got {self.N!r}.")


@dataclass(frozen=True, eq=False)
class Acquired:
    """A record with what only the scoring side may know of it.

    y_true (N, ny) noise-free output; noise_variance (ny,). Both None for measured records.
    """

    record: Record
    y_true: Array | None = None
    noise_variance: Array | None = None


class Source(Protocol):
    """Where records come from: a simulation, a rig, a folder of files."""

    def acquire(
        self, plant: Plant, excitation: Excitation, noise: Noise, sampling: Sampling, rng: np.random.Generator
    ) -> Acquired: ...


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
class Estimate:
    """What a method returns. Fields that a method cannot give are None.

    M, D, K      (n, n) symmetric, SI
    covariance   (ntheta, ntheta) of theta = (vech M, vech D, vech K), vech = upper triangle by rows
                 (mechanics.second_order.pack); zero rows for entries that were not free
    poles        (2n,) continuous-time poles, rad/s, complex
    state_space  (A, B, C, D, h): the discrete (h > 0) or continuous (h = 0) model a black-box method found
    coefficients {"a": (ny..) , "b": ...} of a difference equation, for arx: {"a1": .., "b0": ..} floats
    status, reason, seconds (of fit, filled in by run), diagnostics (flat: name -> number or word)
    """

    M: Array | None = None
    D: Array | None = None
    K: Array | None = None
    covariance: Array | None = None
    poles: NDArray[np.complex128] | None = None
    state_space: tuple[Array, Array, Array, Array, float] | None = None
    coefficients: Mapping[str, float] = field(default_factory=dict[str, float])
    status: Status = "ok"
    reason: str = ""
    seconds: float | None = None
    diagnostics: Mapping[str, Any] = field(default_factory=dict[str, Any])

    @property
    def matrices(self) -> tuple[Array, Array, Array]:
        """M, D, K (n, n). Raises Diverged for an estimate that has none."""
        if self.M is None or self.D is None or self.K is None:
            raise Diverged(f"this estimate has no M, D, K: {self.reason or self.status}.")
        return self.M, self.D, self.K

    def std(self, name: Literal["M", "D", "K"]) -> Array | None:
        """(n, n) standard errors of one matrix, None without a covariance."""
        if self.covariance is None or self.M is None:
            return None
        n = len(self.M)
        q = n * (n + 1) // 2
        start = "MDK".index(name) * q
        S = np.zeros((n, n))
        rows, cols = np.triu_indices(n)
        S[rows, cols] = np.sqrt(np.maximum(np.diag(self.covariance)[start : start + q], 0.0))
        return np.triu(S) + np.triu(S, 1).T


class Method(Protocol):
    """fit(record, model) -> Estimate: pure; the object holds settings only.

    `nominal`: True where the method wants to start at the model's values (in a sweep: the truth, and the
    row says so). A method says NotApplicable or Diverged by raising it.
    """

    nominal: bool

    def fit(self, record: Record, model: Model) -> Estimate: ...


class Analysis(Protocol):
    """A numerical study without a record: one cell of numbers from settings and a seed."""

    def compute(self, plant: Plant, sampling: Sampling, rng: np.random.Generator) -> Mapping[str, float]: ...


@dataclass(frozen=True)
class Cell:
    """One row to be: what answers (a method or an analysis), its labels and its key."""

    key: str
    solver: str
    labels: Mapping[str, Any]


@dataclass(frozen=True)
class Task:
    """One record, acquired once, and the cells that use it.

    parts: group -> JSON text of the node (workers build objects from it); seed: of the record.
    """

    study: str
    kind: str
    parts: Mapping[str, str]
    seed: int
    repetition: int
    labels: Mapping[str, Any]
    cells: tuple[Cell, ...]
    record_key: str
    packages: tuple[str, ...] = ()

    def row(self, cell: Cell, **columns: Any) -> dict[str, Any]:
        """A row of one cell: its labels and `columns`."""
        return {"key": cell.key, "study": self.study, **cell.labels, "seed": self.seed, **columns}

    def without(self, keys: set[str]) -> Task:
        """The same task with only those cells whose key is not in `keys`."""
        cells = tuple(cell for cell in self.cells if cell.key not in keys)
        return replace(self, cells=cells)


class Executor(Protocol):
    """Runs `work(task)`, which yields one row per cell, for every task; yields rows as they come, in any order."""

    def run(
        self, work: Callable[[Task], Iterator[dict[str, Any]]], tasks: Iterable[Task]
    ) -> Iterator[dict[str, Any]]: ...
