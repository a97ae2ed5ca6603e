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
def _played(z, x, gap):
    """Play of half-width gap, from z, once its place has moved to x: also within a step, or it would lag by half of one."""
    return min(max(z, x - gap), x + gap)


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
        inner = _played(z[e], x, P[e, 1]) if kinds[e] == PLAY else z[e]
        g = force(kinds[e], P[e], x, s, inner, t)
        dz[e] = state_rate(kinds[e], P[e], x, s, z[e])
        for i in range(n):
            f[i] -= places[e, i] * g
    for i in range(n):
        a[i] = 0.0
        for j in range(n):
            a[i] += inverse[i, j] * f[j]


@nb.njit(cache=True)
def _advance(n, q, v, z, w0, w1, w2, t, d, inverse, D, K, kinds, places, P, work, rate):
    """q, v after one small step of d seconds; z is moved in place. work (4, n), rate (4, effects): memory."""
    e = d / 2
    _rates(n, q, v, z, w0, t, inverse, D, K, kinds, places, P, work[0], rate[0])
    _rates(
        n,
        q + e * v,
        v + e * work[0],
        z + e * rate[0],
        w1,
        t + e,
        inverse,
        D,
        K,
        kinds,
        places,
        P,
        work[1],
        rate[1],
    )
    qb = q + e * (v + e * work[0])
    _rates(
        n, qb, v + e * work[1], z + e * rate[1], w1, t + e, inverse, D, K, kinds, places, P, work[2], rate[2]
    )
    qc = q + d * (v + e * work[1])
    _rates(
        n, qc, v + d * work[2], z + d * rate[2], w2, t + d, inverse, D, K, kinds, places, P, work[3], rate[3]
    )
    q = q + d * v + d * d / 6 * (work[0] + work[1] + work[2])
    v = v + d / 6 * (work[0] + 2 * work[1] + 2 * work[2] + work[3])
    for e in range(len(kinds)):
        z[e] += d / 6 * (rate[0, e] + 2 * rate[1, e] + 2 * rate[2, e] + rate[3, e])
        if kinds[e] == PLAY:
            z[e] = _played(z[e], places[e] @ q, P[e, 1])
    return q, v


@nb.njit(cache=True)
def _rest(kinds, places, q):
    """Internal states at the start: play is centred where the place is."""
    z = np.zeros(len(kinds))
    for e in range(len(kinds)):
        if kinds[e] == PLAY:
            z[e] = places[e] @ q
    return z


@nb.njit(cache=True)
def integrate(M, D, K, fine, h, small, is_held, kinds, places, P, q0, v0):
    """fine (2 (N-1) small + 1, n): forces at every half small step; a held input is constant over each small step."""
    n = len(M)
    N = (len(fine) - 1) // (2 * small) + 1
    inverse = np.linalg.inv(M)
    d = h / small
    Q, V = np.zeros((N, n)), np.zeros((N, n))
    q, v, z = q0.copy(), v0.copy(), _rest(kinds, places, q0)
    work, rate = np.zeros((4, n)), np.zeros((4, len(kinds)))
    for k in range(N):
        Q[k], V[k] = q, v
        if k == N - 1:
            break
        for s in range(small):
            m = 2 * (k * small + s)
            w0, w1, w2 = (
                (fine[m + 1], fine[m + 1], fine[m + 1]) if is_held else (fine[m], fine[m + 1], fine[m + 2])
            )
            q, v = _advance(
                n, q, v, z, w0, w1, w2, k * h + s * d, d, inverse, D, K, kinds, places, P, work, rate
            )
        if not np.all(np.abs(q) < 1e9):
            Q[k + 1 :] = np.nan
            break
    return Q, V


@nb.njit(cache=True)
def closed_loop(M, D, K, L, r, noise, gain, lead, h, small, kinds, places, P, q0, v0):
    """u = r - gain y - lead (y - y before) / h, held; y = q + noise (N, first DOFs). Q (N, n), u (N, nu)."""
    n, N, seen = len(M), len(r), noise.shape[1]
    inverse = np.linalg.inv(M)
    d = h / small
    Q, U = np.zeros((N, n)), np.zeros((N, L.shape[1]))
    q, v, z = q0.copy(), v0.copy(), _rest(kinds, places, q0)
    work, rate = np.zeros((4, n)), np.zeros((4, len(kinds)))
    before = q[:seen] + noise[0]
    for k in range(N):
        y = q[:seen] + noise[k]
        Q[k], U[k] = q, r[k] - gain @ y - lead @ (y - before) / h
        before = y
        w = L @ U[k]
        for s in range(small):
            q, v = _advance(
                n, q, v, z, w, w, w, k * h + s * d, d, inverse, D, K, kinds, places, P, work, rate
            )
        if not np.all(np.abs(q) < 1e9):
            Q[k + 1 :] = np.nan
            break
    return Q, U


def fine_input(u, h, hold, small, delay=0.0):
    """(2 (N-1) small + 1, nu) values at half small steps; `delay` s later, nothing before the start.

    A held input switches within a small step once it is delayed: each value is then the mean of the step around it.
    """
    N = len(u)
    t = np.arange(2 * (N - 1) * small + 1) / (2 * small) * h - delay
    if hold == "zoh" and delay:
        half, edges = h / (2 * small), np.arange(N + 1) * h
        area = [np.concatenate([[0], np.cumsum(c) * h]) for c in u.T]
        sums = [np.interp(t + half, edges, a) - np.interp(t - half, edges, a) for a in area]
        return np.column_stack(sums) / (2 * half)
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
