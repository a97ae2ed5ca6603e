"""A, B, h -> one step of x' = A x + B u by the rules that the papers compare: zoh, midpoint, Verlet, Euler."""

from __future__ import annotations

import numpy as np

from sysid_bench.mechanics.conversion import c2d_zoh
from sysid_bench.nouns import Array, InputError

RULES = ("midpoint", "verlet", "explicit_euler", "implicit_euler", "zoh")


def one_step(rule: str, A: Array, B: Array, h: float) -> tuple[Array, Array]:
    """Phi (nx, nx), Gamma (nx, nu) of x_k+1 = Phi x_k + Gamma u, u held over the step.

    For midpoint these are A_1/2 and B_1/2 of (3.13) (Bruschetta 2011), whose u is the mean of two samples.
    Verlet wants x = [q; q'] and no damping. Raises InputError on an unknown rule.
    """
    I = np.eye(len(A))
    if rule == "zoh":
        return c2d_zoh(A, B, h)
    if rule == "midpoint":
        left = I - A * h / 2
        return np.linalg.solve(left, I + A * h / 2), h * np.linalg.solve(left, B)
    if rule == "explicit_euler":
        return I + h * A, h * B
    if rule == "implicit_euler":
        return np.linalg.inv(I - h * A), h * np.linalg.solve(I - h * A, B)
    if rule == "verlet":
        return _verlet(A, B, h)
    raise InputError(f"rule must be one of {', '.join(RULES)}; got {rule!r}.")


def _verlet(A: Array, B: Array, h: float) -> tuple[Array, Array]:
    """Velocity Verlet: half a kick, a drift, half a kick."""
    n = len(A) // 2
    I = np.eye(2 * n)
    kick, drift = I.copy(), I.copy()
    kick[n:, :n], drift[:n, n:] = A[n:, :n] * h / 2, h * np.eye(n)
    push = B * h / 2
    return kick @ drift @ kick, kick @ drift @ push + push
