"""A, B, samples of u and what u does between them -> x at the samples, in closed form."""

from __future__ import annotations

import numpy as np
from scipy.linalg import schur
from scipy.signal import lfilter

from sysid_bench.mechanics.bandlimited import input_lines, steady_state
from sysid_bench.mechanics.exponential import balanced
from sysid_bench.mechanics.rules import rule
from sysid_bench.nouns import Array, Complex


def recursion(Ad: Array, forcing: Array, x0: Array) -> Array:
    """x (N, nx) of x[k+1] = Ad x[k] + forcing[k], forcing (N-1, nx), x[0] = x0 (nx,); any real Ad.

    In Schur coordinates Ad is triangular: one first-order filter per state, no eigenvectors, so defective
    and nearly defective Ad cost no accuracy.
    """
    Ad, units = balanced(Ad)
    T, Q = schur(Ad, output="complex")
    drive, start = (forcing / units @ Q.conj()).T, Q.conj().T @ (x0 / units)
    z = np.empty((len(Ad), len(forcing) + 1), dtype=complex)
    z[:, 0] = start
    for i in reversed(range(len(Ad))):
        coupled = drive[i] + T[i, i + 1 :] @ z[i + 1 :, :-1]
        z[i, 1:] = lfilter([1.0], [1.0, -T[i, i]], coupled, zi=T[i, i : i + 1] * start[i])[0]
    return (Q @ z).real.T * units


def free_response(Ad: Array, N: int, x0: Array) -> Array:
    """x (N, nx) of x[k+1] = Ad x[k]."""
    return recursion(Ad, np.zeros((N - 1, len(Ad))), x0)


def propagate(
    A: Array,
    B: Array,
    u: Array,
    h: float,
    hold: str,
    x0: Array | None = None,
    period: int | None = None,
    series: tuple[Array, Complex] | None = None,
) -> Array:
    """x (N, nx) at the samples of x' = A x + B u(t), x(0) = x0 (zero where None), u (N, nu), h in s.

    hold: zoh, foh, cubic, bandlimited (exact), or an integrator of mechanics.rules (cayley, gauss2).
    period, series: for bandlimited, as in nouns.Signal. Raises InputError for an unknown hold.
    """
    x0 = np.zeros(len(A)) if x0 is None else np.asarray(x0, float)
    if hold == "bandlimited":
        steady = steady_state(A, B, input_lines(u, h, period, series), len(u), h)
        Ad, _ = rule("zoh").step(A, B, h)
        return steady + free_response(Ad, len(u), x0 - steady[0])
    chosen = rule(hold)
    Ad, weights = chosen.step(A, B, h)
    forcing = np.einsum("pxu,pku->kx", weights, chosen.coefficients(u), optimize=True)
    return recursion(Ad, forcing, x0)
