"""linear plant + local forces -> trajectory: the compiled loops of trajectory.py.

The linear part is propagated exactly (matrix exponential); each effect's force runs linearly inside a small
step and its end value is solved for implicitly, so stiff contacts and friction that sticks stay stable:
    x1 = Ad x0 + w - sum_e (G0_e f_e(t0) + G1_e f_e(t1)),   f_e(t1) = law_e(c_e' q1, c_e' q1', z, ...)
"""

from __future__ import annotations

import numba as nb
import numpy as np

from sysid_bench.mechanics.tape import play

HEAD = 6


@nb.njit(cache=True, error_model="numpy")
def evaluate_law(e, tape, given, p, pz, z, work, result):
    """Law of effect e at given[0:6]; fills the rest of `given` from states and parameters."""
    operations, constants, starts = tape
    m = HEAD
    for i in range(pz[e, 2], pz[e, 3]):
        given[m] = z[i]
        m += 1
    for i in range(pz[e, 0], pz[e, 1]):
        given[m] = p[i]
        m += 1
    play(operations, constants, starts[e], starts[e + 1], given, work, result)


@nb.njit(cache=True, error_model="numpy")
def _solve_force(e, xa, va, hx, hv, f, tape, given, p, pz, z, work, result):
    """f = law(xa - hx f, va - hv f): Newton, kept inside the bracket of the sign changes seen."""
    low, high = -np.inf, np.inf
    kink = False
    for _ in range(60):
        given[0] = xa - hx * f
        given[1] = va - hv * f
        evaluate_law(e, tape, given, p, pz, z, work, result)
        r = result[0] - f
        if abs(r) <= 1e-8 * abs(f) + 1e-300:
            break
        if r > 0:
            low = f
        else:
            high = f
        slope = 1.0 + result[1] * hx + result[2] * hv
        step = r / slope if slope > 1e-6 else r
        following = f + step
        if not (low < following < high):
            if not kink and hv > 0.0 and low < va / hv < high:
                following = va / hv  # where v = 0: friction that sticks has its root next to it
                kink = True
            elif low > -np.inf and high < np.inf:
                following = 0.5 * (low + high)
            elif not (slope > 1e-6):
                following = f + r
        if abs(following - f) <= 1e-13 * (abs(f) + abs(following)):
            f = following
            break
        f = following
    return f


@nb.njit(cache=True, error_model="numpy")
def _solve_together(xa, va, HX, HV, f, tape, given, p, pz, z, work, result, xb):
    """All forces of one step by Newton on their joint equations; True where it converged (else f is as it was)."""
    ne = len(f)
    trial, r, system = f.copy(), np.zeros(ne), np.zeros((ne, ne))
    for _ in range(12):
        worst = 0.0
        for e in range(ne):
            x, v = xa[e], va[e]
            for d in range(ne):
                x -= HX[e, d] * trial[d]
                v -= HV[e, d] * trial[d]
            given[0], given[1], given[4], given[5] = x, v, xb[e], HV[e, e]
            evaluate_law(e, tape, given, p, pz, z, work, result)
            r[e] = result[0] - trial[e]
            worst = max(worst, abs(r[e]) - 1e-8 * abs(trial[e]))
            for d in range(ne):
                system[e, d] = result[1] * HX[e, d] + result[2] * HV[e, d]
            system[e, e] += 1.0
        if worst <= 1e-300:
            f[:] = trial
            return True
        for e in range(ne):
            if not abs(system[e, e]) > 1e-6:
                return False
            for d in range(e + 1, ne):
                w = system[d, e] / system[e, e]
                for i in range(e, ne):
                    system[d, i] -= w * system[e, i]
                r[d] -= w * r[e]
        for e in range(ne - 1, -1, -1):
            for d in range(e + 1, ne):
                r[e] -= system[e, d] * r[d]
            r[e] /= system[e, e]
            trial[e] += r[e]
    return False


@nb.njit(cache=True, error_model="numpy")
def run(Ad, W, G0, G1, C, x0, z0, tape, p, pz, nwork, nresult, t0, h, X, F, Z):
    """Fills X (S+1, nx), F (S+1, ne), Z (S+1, nz). Returns the number of steps done (S unless it blew up)."""
    S, nx = W.shape
    ne, n = C.shape
    HX, HV = np.zeros((ne, ne)), np.zeros((ne, ne))
    for e in range(ne):
        for d in range(ne):
            for i in range(n):
                HX[e, d] += C[e, i] * G1[d, i]
                HV[e, d] += C[e, i] * G1[d, n + i]
    given = np.zeros(HEAD + len(p) + Z.shape[1])
    work, result = np.zeros(nwork), np.zeros(nresult)
    X[0] = x0
    Z[0] = z0
    xa, va, xb = np.zeros(ne), np.zeros(ne), np.zeros(ne)
    f = np.zeros(ne)
    for e in range(ne):
        x = v = 0.0
        for i in range(n):
            x += C[e, i] * x0[i]
            v += C[e, i] * x0[n + i]
        given[0], given[1], given[2], given[3], given[4], given[5] = x, v, t0, h, x, HV[e, e]
        evaluate_law(e, tape, given, p, pz, Z[0], work, result)
        f[e] = result[0]
        F[0, e] = f[e]
    for k in range(S):
        for i in range(nx):
            s = W[k, i]
            for j in range(nx):
                s += Ad[i, j] * X[k, j]
            for e in range(ne):
                s -= G0[e, i] * F[k, e]
            X[k + 1, i] = s
        for e in range(ne):
            xa[e] = va[e] = xb[e] = 0.0
            for i in range(n):
                xa[e] += C[e, i] * X[k + 1, i]
                va[e] += C[e, i] * X[k + 1, n + i]
                xb[e] += C[e, i] * X[k, i]
        given[2], given[3] = t0 + (k + 1) * h, h
        turns = 50
        if ne > 1 and _solve_together(xa, va, HX, HV, f, tape, given, p, pz, Z[k], work, result, xb):
            turns = 1  # one round more fills the states
        for _ in range(turns):
            change = size = 0.0
            for e in range(ne):
                ax, av = xa[e], va[e]
                for d in range(ne):
                    if d != e:
                        ax -= HX[e, d] * f[d]
                        av -= HV[e, d] * f[d]
                given[2], given[3], given[4], given[5] = t0 + (k + 1) * h, h, xb[e], HV[e, e]
                new = _solve_force(
                    e, ax, av, HX[e, e], HV[e, e], f[e], tape, given, p, pz, Z[k], work, result
                )
                change = max(change, abs(new - f[e]))
                size = max(size, abs(new))
                f[e] = new
                for i in range(pz[e, 3] - pz[e, 2]):
                    Z[k + 1, pz[e, 2] + i] = result[3 + i]
            if ne < 2 or change <= 1e-8 * size:
                break
        fine = True
        for e in range(ne):
            F[k + 1, e] = f[e]
            for i in range(nx):
                X[k + 1, i] -= G1[e, i] * f[e]
        for i in range(nx):
            if not abs(X[k + 1, i]) < 1e100:
                fine = False
        if not fine:
            X[k + 1 :] = np.nan
            return k
    return S


@nb.njit(cache=True, error_model="numpy")
def along(x, v, t0, h, operations, constants, p, z0, nwork, out):
    """Force (N,) of one effect with states along a given motion x, v (N,) of its place; its tape gives [f, z...]."""
    nz = len(z0)
    given = np.zeros(HEAD + nz + len(p))
    given[HEAD : HEAD + nz] = z0
    given[HEAD + nz :] = p
    work, result = np.zeros(nwork), np.zeros(1 + nz)
    for k in range(len(x)):
        before = x[k - 1] if k > 0 else x[0]
        given[0], given[1], given[2], given[3], given[4] = x[k], v[k], t0 + k * h, h, before
        play(operations, constants, 0, len(operations), given, work, result)
        out[k] = result[0]
        given[HEAD : HEAD + nz] = result[1:]
