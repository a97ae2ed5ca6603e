"""plant, hidden effects, input -> motion, by the engine: the input's way to the force, the hidden masses, the laws."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from engine import closed_loop, fine_input, first_order, integrate, slow


@dataclass(frozen=True)
class Machine:
    """M, D, K (n, n), L (n, nu), sampling time h s and how the input runs between samples."""

    M: np.ndarray
    D: np.ndarray
    K: np.ndarray
    L: np.ndarray
    h: float
    hold: str


@dataclass
class Hidden:
    """What the model does not know of: laws (kind, c (n,), p), the input's path and sensors (name, channel, value),
    hidden masses (DOF, kg, N/m, N s/m), a random force (c (n,), N (N,))."""

    laws: list[tuple[int, np.ndarray, tuple]] = field(default_factory=list)
    path: list[tuple[str, int, float]] = field(default_factory=list)
    sensor: list[tuple[str, int, float]] = field(default_factory=list)
    modes: list[tuple[int, float, float, float]] = field(default_factory=list)
    random: tuple[np.ndarray, np.ndarray] | None = None


def run(
    machine: Machine, hidden: Hidden, u: np.ndarray, small: int, x0=None
) -> tuple[np.ndarray, np.ndarray]:
    """q, v (N, n) of a free run with `small` integration steps per sample; NaN from where it leaves every bound."""
    w, is_held = _at_the_force(machine, hidden, u, small)
    f = w @ machine.L.T
    if hidden.random is not None:
        c, force = hidden.random
        f = f + np.outer(np.interp(np.arange(len(f)) / (2 * small), np.arange(len(u)), force[: len(u)]), c)
    M, D, K, q0, v0 = _grown(machine, hidden, x0)
    f = np.pad(f, ((0, 0), (0, len(M) - f.shape[1])))
    Q, V = integrate(
        M, D, K, np.ascontiguousarray(f), machine.h, small, is_held, *_laws(hidden, len(M)), q0, v0
    )
    n = len(machine.M)
    return Q[:, :n], V[:, :n]


def run_in_loop(machine: Machine, hidden: Hidden, r, noise, gain, lead, small: int, x0=None):
    """q (N, n), u (N, nu): a controller gain, lead (nu, n) feeds the noisy position back onto the reference r."""
    M, D, K, q0, v0 = _grown(machine, hidden, x0)
    L = np.pad(machine.L, ((0, len(M) - len(machine.L)), (0, 0)))
    Q, U = closed_loop(
        M, D, K, L, r, noise, gain, lead, machine.h, small, *_laws(hidden, len(M)), q0, v0
    )  # fmt: skip
    return Q[:, : len(machine.M)], U


def _at_the_force(machine: Machine, hidden: Hidden, u: np.ndarray, small: int) -> tuple[np.ndarray, bool]:
    """(2 (N-1) small + 1, nu) at half small steps, after the actuators; True where it is constant over small steps."""
    delay = np.zeros(u.shape[1])
    for name, ch, p in hidden.path:
        if name == "input_delay":
            delay[ch] += p
    w = np.column_stack(
        [fine_input(u[:, [c]], machine.h, machine.hold, small, delay[c])[:, 0] for c in range(u.shape[1])]
    )
    d, is_held = machine.h / (2 * small), machine.hold == "zoh"
    for name, ch, p in hidden.path:
        if name == "saturation":
            w[:, ch] = np.clip(w[:, ch], -p, p)
        if name == "input_dead_band":
            w[:, ch] -= np.clip(w[:, ch], -p, p)
        if name == "input_square":
            w[:, ch] += p * (w[:, ch] ** 2 - np.mean(w[:, ch] ** 2))
        if name == "rate_limit":
            w[:, ch] = slow(w[:, ch].copy(), p * d)
        if name == "actuator_lag":
            w[:, ch] = first_order(w[:, ch].copy(), d, p, machine.hold == "zoh")
            is_held = False
    return w, is_held


def _grown(machine: Machine, hidden: Hidden, x0: Any):
    """M, D, K with the hidden masses, and the start: each hidden mass rests on its spring."""
    M, D, K, n = machine.M, machine.D, machine.K, len(machine.M)
    for i, m, k, damping in hidden.modes:
        M, D, K = (np.pad(X, ((0, 1), (0, 1))) for X in (M, D, K))
        M[-1, -1] = m
        b = np.zeros(len(M))
        b[i], b[-1] = 1, -1
        K = K + k * np.outer(b, b)
        D = D + damping * np.outer(b, b)
    q0, v0 = np.zeros(len(M)), np.zeros(len(M))
    if x0 is not None:
        q0[:n], v0[:n] = x0[0], x0[1]
        for k in range(n, len(M)):
            q0[k] = q0[hidden.modes[k - n][0]]
    return M, D, K, q0, v0


def _laws(hidden: Hidden, n: int):
    kinds = np.array([kind for kind, _, _ in hidden.laws], dtype=np.int64)
    places = np.array([np.pad(c, (0, n - len(c))) for _, c, _ in hidden.laws]).reshape(len(kinds), n)
    P = np.array([list(p) + [0.0] * (6 - len(p)) for _, _, p in hidden.laws]).reshape(len(kinds), 6)
    return kinds, places, P


def sensed(hidden: Hidden, Y: np.ndarray) -> np.ndarray:
    """(N, n) what the sensors show of positions Y."""
    Y, t = np.array(Y), np.arange(len(Y)) / len(Y)
    for name, i, p in hidden.sensor:
        if name == "sensor_bias":
            Y[:, i] += p
        if name == "sensor_drift":
            Y[:, i] += p * t
        if name == "quantisation":
            Y[:, i] = p * np.round(Y[:, i] / p)
        if name == "sensor_clipping":
            Y[:, i] = np.clip(Y[:, i], -p, p)
    return Y
