"""residual and linear model -> the motion that really was, the plant's response, and the force that is unexplained."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sysid_bench.gap.free_run import hold_of, shown, substeps_for
from sysid_bench.gap.place_forces import force_along
from sysid_bench.gap.problem import Point, Problem
from sysid_bench.gap.traces import Trace
from sysid_bench.mechanics.assembly import Assembly, assemble
from sysid_bench.mechanics.trajectory import Trajectory, trajectory
from sysid_bench.nouns import Array


@dataclass(frozen=True, eq=False)
class Moved:
    """A motion as it was measured, not simulated: q, v, a (N, n)."""

    q: Array
    v: Array
    a: Array


@dataclass(frozen=True, eq=False)
class Seen:
    """The smoothed motion of one trace, its linear model and what that model leaves.

    q, v, a (N, n) with what the residual tells added; G (F, ny, n) response of the measured channels to forces;
    left (F, ny) measured minus the linear model's response; linear: that model's run
    """

    trace: Trace
    q: Array
    v: Array
    a: Array
    G: np.ndarray
    left: np.ndarray
    linear: Trajectory


def response(assembly: Assembly, omega: Array, output: str, channels: bool = True) -> np.ndarray:
    """(F, ny, n) of the measured channels, or (F, n, n) of the DOFs, to a force on each DOF."""
    s = 1j * omega[:, None, None]
    # a trace of stiffness, so that a free mass has a response at its lowest bin too
    lowest = omega[1] if len(omega) > 1 else 1.0
    K = assembly.K + 1e-6 * lowest**2 * np.diag(np.diag(assembly.M))
    G = np.linalg.inv(assembly.M * s**2 + assembly.D * s + K)
    power = {"displacement": 0, "velocity": 1, "acceleration": 2}[output]
    return (assembly.C @ G if channels else G) * s**power


def smoothed(problem: Problem, trace: Trace, run: Trajectory | Moved) -> tuple[Array, Array, Array]:
    """q, v, a (N, n): the simulated motion plus what the residual adds to it (Wiener filter per bin)."""
    if isinstance(run, Moved):
        return run.q, run.v, run.a
    n = problem.model.n
    q, v, a = (x[:, :n] for x in run.motion())
    left = trace.spectrum(trace.filled(trace.y - shown(problem, trace, run)))
    power = {"displacement": 0, "velocity": 1, "acceleration": 2}[problem.model.output]
    X = (
        _added(problem, trace, run, left)
        if problem.model.output_map.shape[0] < n
        else _inverted(problem, trace, left, power)
    )
    s = 1j * trace.omega[:, None]
    return q + trace.signal(X), v + trace.signal(s * X), a + trace.signal(s * s * X)


def _gain(trace: Trace, left: np.ndarray) -> Array:
    power = np.abs(left * trace.weight) ** 2 / 2
    S = np.column_stack([_averaged(c) for c in power.T]) / _averaged(np.ones(trace.F))[:, None]
    return np.maximum(0, 1 - 1.3 / np.maximum(S, 1e-12))


def _averaged(power: Array) -> Array:
    """(F,) mean over nine neighbouring bins, of all where there are fewer; zero beyond the ends."""
    width = min(9, len(power))
    return np.convolve(power, np.ones(width) / width, "same")


def _inverted(problem: Problem, trace: Trace, left: np.ndarray, power: int) -> np.ndarray:
    """Every DOF is seen: the filtered residual is the correction; of derivatives only above the lowest bins."""
    X = (_gain(trace, left) * left) @ np.linalg.pinv(problem.model.output_map).T
    if power == 0:
        return X
    X[4:] /= (1j * trace.omega[4:, None]) ** power
    X[:4] = 0
    return X


def _added(problem: Problem, trace: Trace, run: Trajectory, left: np.ndarray) -> np.ndarray:
    """Fewer sensors than DOFs: the motion of the smallest white force that explains the residual."""
    own = problem.model.n
    H = response(run.assembly, trace.omega, problem.model.output)
    G = response(run.assembly, trace.omega, "displacement", channels=False)[:, :own, :own]
    H = H[:, :, :own] * trace.weight[:, :, None]
    r = left * trace.weight
    signal = _averaged(np.maximum(np.sum(np.abs(r) ** 2, 1) / r.shape[1] / 2 - 1, 0))
    gain = signal / np.maximum(np.einsum("fij,fij->f", H, H.conj()).real / r.shape[1], 1e-300)
    S = H @ H.conj().transpose(0, 2, 1) * gain[:, None, None] + 2 * np.eye(r.shape[1])
    force = gain[:, None, None] * H.conj().transpose(0, 2, 1) @ np.linalg.solve(S, r[:, :, None])
    return (G @ force)[:, :, 0]


def linearised(problem: Problem, point: Point, q: Array, v: Array, trace: Trace) -> Assembly:
    """The point's model with each force effect replaced by the spring and damper that serve best on this motion."""
    A = assemble(problem.model_at(point))
    D, K, n = np.array(A.D), np.array(A.K), problem.model.n
    for effect, c in zip(A.forces, A.directions):
        if effect.name in ("constant_force", "periodic_disturbance"):
            continue
        x, s = q @ c[:n], v @ c[:n]
        f = force_along(effect, x, s, trace.h, trace.t0)
        spring = (f @ x) / max(x @ x, 1e-300)
        damper = max((f @ s) / max(s @ s, 1e-300), 0.0)
        held = c @ K @ c / (c @ c) ** 2
        K += max(spring, -0.8 * held) * np.outer(c, c)
        D += damper * np.outer(c, c)
    return replace(A, D=D, K=K, forces=(), directions=np.zeros((0, A.n)))


def seen(problem: Problem, point: Point, trace: Trace, run: Trajectory, x0: Array) -> Seen:
    """What a screen needs of one trace: for this linear model `left` is exactly its response to all that is missing."""
    q, v, a = smoothed(problem, trace, run)
    A = linearised(problem, point, q, v, trace)
    A = _stabilised(problem, A)
    substeps = substeps_for(point.effects, problem.model.n)
    stages = trace.stages(substeps, hold_of(point.effects, trace))
    linear = trajectory(A, stages, trace.h, substeps, x0, trace.t0, trace.pulls(substeps))
    left = trace.spectrum(trace.filled(trace.y - shown(problem, trace, linear)))
    return Seen(trace, q, v, a, response(A, trace.omega, problem.model.output), left, linear)


def _stabilised(problem: Problem, A: Assembly) -> Assembly:
    """The same with nominal damping and stiffness where the fitted ones are not stable."""
    ok = np.linalg.eigvalsh(A.K)[0] > 0 and np.linalg.eigvalsh(A.D)[0] > -1e-9 * np.abs(A.D).max()
    if ok or A.n != problem.model.n:
        return A
    M, D, K = problem.model.matrices
    D = D + 0.05 * np.diag(np.sqrt(np.diag(M) * np.abs(np.diag(K))))
    return replace(A, M=M, D=D, K=K)


def free_response(assembly: Assembly, trace: Trace, output: str) -> np.ndarray:
    """(F, ny, 2 n) DFT of the measured response to each initial state, up to a change of basis."""
    n = assembly.n
    inverse = np.linalg.inv(assembly.M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ assembly.K, -inverse @ assembly.D]])
    poles, V = np.linalg.eig(A + 1e-9 * np.abs(A).max() * np.diag(np.linspace(1, 2, 2 * n)))
    z = np.exp(-1j * trace.omega * trace.h)
    modes = 1 / (1 - np.exp(poles * trace.h)[None, :] * z[:, None])
    power = {"displacement": 0, "velocity": 1, "acceleration": 2}[output]
    shape = assembly.C @ (V[:n] * poles**power)
    return np.einsum("cm,fm,mk->fck", shape, modes, np.linalg.inv(V), optimize=True)
