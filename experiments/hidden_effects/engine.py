"""plant, hidden forces, input -> motion: the trials' own simulator. It shares no line with the workflow it judges.

Runge-Kutta of order 4 with many small steps; every force law is written here again, with other smoothing and other
parameters than the catalogue's. tests/test_hidden_effects.py holds it against scipy's Radau.
"""

import numba as nb
import numpy as np
from scipy.interpolate import CubicSpline

(COULOMB, STRIBECK, DAHL, LOAD, DRAG, CUBIC, SQUARE, GAP, PLAY, BOUC_WEN, STOP, RIPPLE, SLOPE, SWING, TONE, CONSTANT,
 CUBIC_DAMPING, VAN_DER_POL, SQUARE_SPEED, EXPONENTIAL, LOCAL_DAMPING, TIMED_DAMPING, ROOT_SPEED, SINE_SPEED,
 PRODUCT) = range(25)  # fmt: skip


@nb.njit(cache=True)
def force(kind, p, x, v, z, t):
    if kind == COULOMB:
        return p[0] * v / np.sqrt(v * v + p[1] * p[1])
    if kind == STRIBECK:
        return (p[0] + p[1] * np.exp(-((abs(v) / p[2]) ** 2))) * v / np.sqrt(v * v + p[3] * p[3])
    if kind == DAHL:
        return p[0] * z
    if kind == LOAD:
        return p[0] * abs(x) * np.tanh(v / p[1])
    if kind == DRAG:
        return p[0] * v * abs(v)
    if kind == CUBIC:
        return p[0] * x**3
    if kind == SQUARE:
        return p[0] * x * x
    if kind == GAP:  # the model's spring, minus what it does inside the clearance
        return (p[0] * (abs(x) - p[1]) * np.sign(x) if abs(x) > p[1] else 0.0) - p[0] * x
    if kind == PLAY:
        return p[0] * z - p[0] * x
    if kind == BOUC_WEN:
        return p[0] * z
    if kind == STOP:
        over, under = x - p[1], -x - p[1]
        if over > 0 and p[2] >= 0:
            return max(p[0] * over + p[3] * v, 0.0)
        if under > 0 and p[2] <= 0:
            return min(-p[0] * under + p[3] * v, 0.0)
        return 0.0
    if kind == RIPPLE:
        return p[0] * np.cos(p[1] * x + p[2])
    if kind == SLOPE:
        return p[0] * t * x
    if kind == SWING:
        return p[0] * np.cos(p[1] * t + p[2]) * x
    if kind == TONE:
        return p[0] * np.cos(p[1] * t + p[2])
    if kind == CONSTANT:
        return p[0]
    if kind == CUBIC_DAMPING:
        return p[0] * v**3
    if kind == VAN_DER_POL:
        return p[0] * x * x * v
    if kind == SQUARE_SPEED:
        return p[0] * v * v
    if kind == EXPONENTIAL:
        return p[0] * (np.exp(x / p[1]) - 1 - x / p[1])
    if kind == LOCAL_DAMPING:
        return p[0] * v * np.exp(-((x / p[1]) ** 2))
    if kind == TIMED_DAMPING:
        return p[0] * v * (1 + np.sin(p[1] * t))
    if kind == ROOT_SPEED:
        return p[0] * np.sign(v) * np.sqrt(abs(v))
    if kind == SINE_SPEED:
        return p[0] * np.sin(v / p[1])
    if kind == PRODUCT:
        return p[0] * x * v
    return 0.0


@nb.njit(cache=True)
def state_rate(kind, p, x, v, z):
    if kind == DAHL:  # z' = v (1 - sign(v) z / z_max)
        return v - abs(v) * z / p[1]
    if kind == BOUC_WEN:  # z' = A v - beta |v| |z|^(n-1) z - gamma v |z|^n
        return v - p[1] * abs(v) * abs(z) ** (p[3] - 1) * z - p[2] * v * abs(z) ** p[3]
    return 0.0


@nb.njit(cache=True)
def _rates(n, q, v, z, w, t, inverse, D, K, kinds, places, P, a, dz):
    f = np.empty(n)
    for i in range(n):
        f[i] = w[i]
        for j in range(n):
            f[i] -= D[i, j] * v[j] + K[i, j] * q[j]
    for e in range(len(kinds)):
        x = 0.0
        s = 0.0
        for i in range(n):
            x += places[e, i] * q[i]
            s += places[e, i] * v[i]
        g = force(kinds[e], P[e], x, s, z[e], t)
        dz[e] = state_rate(kinds[e], P[e], x, s, z[e])
        for i in range(n):
            f[i] -= places[e, i] * g
    for i in range(n):
        a[i] = 0.0
        for j in range(n):
            a[i] += inverse[i, j] * f[j]


@nb.njit(cache=True)
def integrate(M, D, K, fine, h, small, is_held, kinds, places, P, q0, v0):
    """fine (2 (N-1) small + 1, n): forces at every half small step; a held input is constant over each small step."""
    n = len(M)
    N = (len(fine) - 1) // (2 * small) + 1
    inverse = np.linalg.inv(M)
    d = h / small
    Q, V = np.zeros((N, n)), np.zeros((N, n))
    q, v = q0.copy(), v0.copy()
    ne = len(kinds)
    z = np.zeros(ne)
    for e in range(ne):
        if kinds[e] == PLAY:
            for i in range(n):
                z[e] += places[e, i] * q[i]
    a1, a2, a3, a4 = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    z1, z2, z3, z4 = np.zeros(ne), np.zeros(ne), np.zeros(ne), np.zeros(ne)
    for k in range(N):
        Q[k], V[k] = q, v
        if k == N - 1:
            break
        for s in range(small):
            m = 2 * (k * small + s)
            t = k * h + s * d
            w0, w1, w2 = (
                (fine[m + 1], fine[m + 1], fine[m + 1]) if is_held else (fine[m], fine[m + 1], fine[m + 2])
            )
            e = d / 2
            _rates(n, q, v, z, w0, t, inverse, D, K, kinds, places, P, a1, z1)
            _rates(n, q + e * v, v + e * a1, z + e * z1, w1, t + e, inverse, D, K, kinds, places, P, a2, z2)
            qb = q + e * (v + e * a1)
            _rates(n, qb, v + e * a2, z + e * z2, w1, t + e, inverse, D, K, kinds, places, P, a3, z3)
            qc = q + d * (v + e * a2)
            _rates(n, qc, v + d * a3, z + d * z3, w2, t + d, inverse, D, K, kinds, places, P, a4, z4)
            q = q + d * v + d * d / 6 * (a1 + a2 + a3)
            v = v + d / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
            for e in range(ne):
                z[e] += d / 6 * (z1[e] + 2 * z2[e] + 2 * z3[e] + z4[e])
                if kinds[e] == PLAY:
                    x = 0.0
                    for i in range(n):
                        x += places[e, i] * q[i]
                    z[e] = min(max(z[e], x - P[e, 1]), x + P[e, 1])
        if not np.all(np.abs(q) < 1e9):
            Q[k + 1 :] = np.nan
            break
    return Q, V


def fine_input(u, h, hold, small, delay=0.0):
    """(2 (N-1) small + 1, nu) values at half small steps; `delay` s later, nothing before the start."""
    N = len(u)
    t = np.arange(2 * (N - 1) * small + 1) / (2 * small) * h - delay
    if hold == "zoh":
        at = np.clip(np.floor(t / h + 1e-9).astype(int), 0, N - 1)
        w = u[at]
    elif hold == "foh":
        w = np.column_stack([np.interp(t, np.arange(N) * h, c) for c in u.T])
    else:
        w = CubicSpline(np.arange(N) * h, u)(np.maximum(t, 0))
    w[t < -1e-9 * h] = 0
    return w


@nb.njit(cache=True)
def first_order(w, d, T, is_held):
    y = np.zeros_like(w)
    e = np.exp(-d / T)
    for k in range(1, len(w)):
        y[k] = e * y[k - 1] + (1 - e) * (w[k - 1] if is_held else 0.5 * (w[k] + w[k - 1]))
    return y


@nb.njit(cache=True)
def slow(w, step):
    y = w.copy()
    for k in range(1, len(w)):
        y[k] = y[k - 1] + min(max(w[k] - y[k - 1], -step), step)
    return y
