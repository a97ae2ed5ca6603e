"""a free mass, often in closed loop -> the gap on the force: what its position cannot tell.

A position that may drift, or that a controller holds, says little about what is missing; the force does. So the
measured motion goes through the model, and what force it needs is compared with the force that was given.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sysid_bench.effects import effect
from sysid_bench.gap.inverse import PHASE, ForceProblem, fade, measured_motion, own_phases, rows_of
from sysid_bench.gap.laps import SENSORS, force_floor
from sysid_bench.gap.problem import Problem
from sysid_bench.gap.traces import SMOOTHING_BINS, Trace, trace_of, white_floor
from sysid_bench.mechanics.effect import Effect, as_effects
from sysid_bench.nouns import Array, Model, Record

DROWNED = 0.05  # share of noise in the force, from which a free run tells more
NOISY = 0.1  # share of noise in the force's power at which the band ends
FIRST_PART = 0.25  # of a test record (and of what shows a phase): phases are fitted there, the gap is taken on the rest
# A drifting position cannot tell these from an offset of the force, which is fitted from the start.
DRIFTING = frozenset({"sensor_bias", "sensor_drift", "constant_force", "sensor_scale"})
# What such a drive cuts off cannot be read back from the motion: with less force given, less is missing.
CUTTING = frozenset({"saturation", "input_dead_band", "rate_limit"})
# Well below the sampling rate a hold is a delay of half a sample: one class, called by its delay.
HOLDS = frozenset({"wrong_hold"})
# Named where motion and force are both at hand: differences between directions, friction behind a play.
ONLY_FREE = frozenset({"asymmetric_friction", "friction_behind_play"})


def floats(model: Model) -> bool:
    """True where the model can move away freely and every DOF is seen as a displacement; the same in any units."""
    M, D, K = model.matrices
    scale = max(np.abs(K).max(), np.linalg.norm(D, 2) ** 2 / np.linalg.eigvalsh(M)[-1])
    seen = model.output == "displacement" and np.array_equal(model.output_map, np.eye(model.n))
    return bool(seen and np.linalg.eigvalsh(K)[0] <= 1e-9 * scale)


def drowned(problem: ForceProblem, how: str) -> bool:
    """True where the sensors' noise, differentiated twice, takes a share of the force that hides much: no lap shows less."""
    given = [problem.rows_on(k, t.u @ problem.model.input_map.T) for k, t in enumerate(problem.traces)]
    return how == SENSORS and float(np.mean(np.concatenate(given) ** 2)) < DROWNED**-2


def admissible(catalogue: list[type[Effect]], problem: Problem) -> list[type[Effect]]:
    """The names that such records can carry."""
    barred = DRIFTING | HOLDS | CUTTING if problem.on_force else ONLY_FREE
    return [kind for kind in catalogue if kind.name not in barred]


def with_offset(model: Model) -> Model:
    """The model with an offset of the force on every DOF that is free to drift, zero to begin with."""
    if not floats(model) or any(e.name == "constant_force" for e in model.effects):
        return model
    offsets = (effect("constant_force", i, {"force": 0.0}) for i in range(model.n))
    return replace(model, effects=(*model.effects, *offsets))


def on_force(problem: Problem, lattice: Array) -> tuple[ForceProblem, str]:
    """The problem on the force, banded and whitened by its noise floor; how the floor was found, in words."""
    shortened = [cropped(trace) for trace in problem.traces]
    end = max(band_on_force(problem.model, trace, lattice) for trace in shortened)
    traces = tuple(force_banded(trace, end) for trace in shortened)
    motions = tuple(measured_motion(trace) for trace in traces)
    bare = ForceProblem(problem.model, traces, problem.entries, problem.scale, motions=motions)
    variances = [white_floor(t, _between_ends(t.y), lattice) for t in shortened]
    sigma, how = force_floor(bare, variances)
    traces = tuple(replace(t, weight=t.weight / sigma, variance=v) for t, v in zip(traces, variances))
    return replace(bare, traces=traces), how


def cropped(trace: Trace) -> Trace:
    """The trace without the few last samples that make a slow Fourier transform."""
    N = next(n for n in range(trace.N, 0, -1) if _smooth(n))
    return replace(trace, u=trace.u[:N], y=trace.y[:N], good=trace.good[:N], _stages={})


def _smooth(n: int) -> bool:
    for factor in (2, 3, 5, 7, 11):
        while n % factor == 0:
            n //= factor
    return n == 1


def _between_ends(x: Array) -> Array:
    """x (N, c) without the line between its ends, brought to zero there: a drift would leak into every frequency."""
    share = np.linspace(0, 1, len(x))[:, None]
    return (x - (1 - share) * x[:1] - share * x[-1:]) * fade(len(x))[:, None]


def band_on_force(model: Model, trace: Trace, lattice: Array) -> float:
    """rad/s from which on the force of the sensors' noise is no longer small beside the force that was given."""
    variance = white_floor(trace, _between_ends(trace.y), lattice)
    omega = 2 * np.pi * np.fft.rfftfreq(trace.N, trace.h)
    given = _between_ends(trace.u) @ model.input_map.T
    S = np.abs(np.fft.rfft(given, axis=0)) ** 2 / trace.N
    kernel, end, (M, _, _) = np.ones(SMOOTHING_BINS) / SMOOTHING_BINS, 0.0, model.matrices
    for i in np.flatnonzero(np.any(model.input_map != 0, axis=1)):
        noise = (M[i, i] * omega**2) ** 2 * variance[i]
        over = noise > NOISY * np.convolve(S[:, i], kernel, "same")
        over[:SMOOTHING_BINS] = False
        end = max(end, omega[np.argmax(over)] if over.any() else omega[-1])
    return float(np.clip(end, 40 * np.pi / (trace.N * trace.h), 0.4 * np.pi / trace.h))


def force_banded(trace: Trace, end: float) -> Trace:
    """The trace cut at `end` rad/s, with unit weights."""
    F = max(int(np.searchsorted(2 * np.pi * np.fft.rfftfreq(trace.N, trace.h), end)), 8)
    return replace(trace, F=F, weight=np.ones((F, trace.y.shape[1])), variance=np.ones(trace.y.shape[1]))


@dataclass(frozen=True, eq=False)
class OnForce:
    """A record judged on the force: given (R, n) and needed (R, n) in the band, at t (R,); model with its own phases.

    gap: the share missed; floor: the noise's share. The gap is |F - Fhat| / |F| after the first quarter of the record, where the record's own phases were fitted.
    """

    model: Model
    t: Array
    given: Array
    needed: Array
    gap: float
    floor: float


def judge_on_force(models: dict[str, Model], record: Record, problem: ForceProblem) -> dict[str, OnForce]:
    """The gaps of several models on one record, all on the same rest of it; the last one says where that begins."""
    end = float(problem.traces[0].omega[-1]) * (1 + 1e-9)
    trace = force_banded(cropped(trace_of(record, problem.model)), end)
    here = replace(problem, traces=(trace,), motions=(measured_motion(trace),))
    first = first_part(here, list(models.values())[-1])
    return {name: _judged(here, model, first, problem.traces[0].weight[0]) for name, model in models.items()}


def first_part(here: ForceProblem, model: Model) -> np.ndarray:
    """(2 F,) bool: the first quarter of a record; more where that holds less than a quarter of what shows a phase."""
    rows = 2 * here.traces[0].F
    last = FIRST_PART * rows
    for wave in (e for e in as_effects(model.effects) if e.path == "force" and PHASE in e.numeric):
        power = (rows_of(here.traces[0], here.wave(wave, 0)) ** 2).sum(axis=1) * here.kept(0)
        last = max(last, np.searchsorted(np.cumsum(power), FIRST_PART * power.sum()) + 1)
    return np.arange(rows) < min(last, 0.75 * rows)


def _judged(here: ForceProblem, model: Model, first: np.ndarray, weight: Array) -> OnForce:
    trace, rows = here.traces[0], len(first)
    own = replace(model, effects=own_phases(here, 0, model, first))
    given, needed = (rows_of(trace, x, keep=False) for x in here.forces(own, 0))
    t = trace.t0 + np.arange(rows) * trace.N * trace.h / rows
    scored = here.kept(0) & ~first
    gap, size = given - needed, np.linalg.norm(given[scored])
    floor = np.sqrt(scored.sum() * np.sum(1 / weight**2)) / size
    return OnForce(own, t, given, needed, float(np.linalg.norm(gap[scored]) / size), float(floor))
