"""linear plant + local forces -> trajectory: the compiled loops of trajectory.py.

The linear part is propagated exactly (matrix exponential); each effect's force runs linearly inside a small
step and its end value is solved for implicitly, so stiff contacts and friction that sticks stay stable:
    x1 = Ad x0 + w - sum_e (G0_e f_e(t0) + G1_e f_e(t1)),   f_e(t1) = law_e(c_e' q1, c_e' q1', z, ...)
"""

from __future__ import annotations

import numba as nb
import numpy as np

from sysid_bench.mechanics.compiled import UNCOUNTED
from sysid_bench.mechanics.play import play, play_rows

HEAD = 6


@nb.njit(**UNCOUNTED, forceinline=True)
def law_at(e, operations, laws, cells, x, v):
    """Evaluate law e at displacement x and velocity v of its place; the number of the first of its results."""
    cells[laws[e, 0]] = x
    cells[laws[e, 0] + 1] = v
    play(operations, laws[e, 5], laws[e, 2], cells)
    return laws[e, 3]


@nb.njit(**UNCOUNTED, forceinline=True)
def settle(operations, laws, cells, mobility, h):
    """What stays the same during a run: the small step, the mobilities and what depends on parameters alone."""
    for e in range(len(laws)):
        cells[laws[e, 0] + 3], cells[laws[e, 0] + 5] = h, mobility[e, e]
        play(operations, laws[e, 1], laws[e, 5], cells)


@nb.njit(**UNCOUNTED, forceinline=True)
def prepare(laws, cells, spans, Z, k, t, xb):
    """Put what a step knows before its end into the cells: time, displacements before, internal states."""
    for e in range(len(laws)):
        at = laws[e, 0]
        cells[at + 2], cells[at + 4] = t, xb[e]
        for i in range(spans[e, 2], spans[e, 3]):
            cells[at + HEAD + i - spans[e, 2]] = Z[k, i]


@nb.njit(cache=True, error_model="numpy")
def reach(C, G1):
    """HX, HV (ne, ne): displacement and velocity that a force at place d, rising over a step, takes from place e."""
    n = C.shape[1]
    return C @ np.ascontiguousarray(G1[:, :n].T), C @ np.ascontiguousarray(G1[:, n:].T)


@nb.njit(**UNCOUNTED, forceinline=True)
def _solve_force(e, xa, va, hx, hv, f, operations, results, laws, cells):
    """f = law(xa - hx f, va - hv f): Newton, kept inside the bracket of the sign changes seen."""
    low, high = -np.inf, np.inf
    kink = False
    for _ in range(60):
        at = law_at(e, operations, laws, cells, xa - hx * f, va - hv * f)
        r = cells[results[at]] - f
        if abs(r) <= 1e-8 * abs(f) + 1e-300:
            break
        if r > 0:
            low = f
        else:
            high = f
        slope = 1.0 + cells[results[at + 1]] * hx + cells[results[at + 2]] * hv
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


@nb.njit(**UNCOUNTED, forceinline=True)
def _eliminate(system, r):
    """Solve in place, r becoming the solution; False where a pivot is too small for elimination in order."""
    ne = len(r)
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
    return True


@nb.njit(**UNCOUNTED, forceinline=True)
def _solve_together(xa, va, HX, HV, f, operations, results, laws, cells, trial, r, system):
    """All forces of one step by Newton on their joint equations; True where it converged (else f is as it was)."""
    ne = len(f)
    for e in range(ne):
        trial[e] = f[e]
    for _ in range(12):
        done = True
        for e in range(ne):
            x, v = xa[e], va[e]
            for d in range(ne):
                x -= HX[e, d] * trial[d]
                v -= HV[e, d] * trial[d]
            at = law_at(e, operations, laws, cells, x, v)
            r[e] = cells[results[at]] - trial[e]
            if not abs(r[e]) <= 1e-8 * abs(trial[e]) + 1e-300:
                done = False
            for d in range(ne):
                system[e, d] = cells[results[at + 1]] * HX[e, d] + cells[results[at + 2]] * HV[e, d]
            system[e, e] += 1.0
        if done:
            for e in range(ne):
                f[e] = trial[e]
            return True
        if not _eliminate(system, r):
            return False
        for e in range(ne):
            trial[e] += r[e]
    return False


@nb.njit(**UNCOUNTED, forceinline=True)
def _solve_in_turn(xa, va, HX, HV, f, operations, results, laws, cells):
    """The forces of one step, each alone with the others as they are, until none moves."""
    ne = len(f)
    for _ in range(50):
        change = size = 0.0
        for e in range(ne):
            ax, av = xa[e], va[e]
            for d in range(ne):
                if d != e:
                    ax -= HX[e, d] * f[d]
                    av -= HV[e, d] * f[d]
            new = _solve_force(e, ax, av, HX[e, e], HV[e, e], f[e], operations, results, laws, cells)
            change = max(change, abs(new - f[e]))
            size = max(size, abs(new))
            f[e] = new
        if ne < 2 or change <= 1e-8 * size:
            break


@nb.njit(**UNCOUNTED, forceinline=True)
def place(C, X, k, xs, vs):
    """Displacements and velocities xs, vs (ne,) of the places at state X[k]."""
    ne, n = C.shape
    for e in range(ne):
        xs[e] = vs[e] = 0.0
        for i in range(n):
            xs[e] += C[e, i] * X[k, i]
            vs[e] += C[e, i] * X[k, n + i]


@nb.njit(**UNCOUNTED, forceinline=True)
def _without_end_forces(columns, W, G0, X, F, k):
    """X[k + 1], but for what the effects' forces at its end add. columns (nx, nx): the transpose of Ad.

    Two columns at a time: each state is read and written half as often.
    """
    ne, nx = G0.shape
    for i in range(nx):
        X[k + 1, i] = W[k, i]
    for j in range(0, nx, 2):
        a, b = X[k, j], X[k, j + 1]
        for i in range(nx):
            X[k + 1, i] += a * columns[j, i] + b * columns[j + 1, i]
    for e in range(ne):
        f = F[k, e]
        for i in range(nx):
            X[k + 1, i] -= f * G0[e, i]


@nb.njit(cache=True, error_model="numpy")
def run(Ad, W, G0, G1, C, x0, z0, operations, results, laws, cells, spans, t0, h, X, F, Z):
    """Fills X (S+1, nx), F (S+1, ne), Z (S+1, nz). Returns the number of steps done (S unless it blew up)."""
    ne = len(C)
    HX, HV = reach(C, G1)
    X[0] = x0
    Z[0] = z0
    motions, forces, system = np.zeros((4, ne)), np.zeros((3, ne)), np.zeros((ne, ne))
    done = _steps(
        Ad.T.copy(), W, G0, G1, C, HX, HV, operations, results, laws, cells, spans, t0, h, X, F, Z,
        motions[0], motions[1], motions[2], motions[3], forces[0], forces[1], forces[2], system,
    )  # fmt: skip
    if done < len(W):
        X[done + 1 :] = np.nan
    return done


@nb.njit(**UNCOUNTED)
def _steps(
    columns, W, G0, G1, C, HX, HV, operations, results, laws, cells, spans, t0, h, X, F, Z,
    xa, va, xb, vb, f, trial, r, system,
):  # fmt: skip
    """All steps of a run; from xa on arrays to work in, for nothing is allocated here and no reference counted."""
    S, nx = W.shape
    ne = len(C)
    settle(operations, laws, cells, HV, h)
    place(C, X, 0, xb, vb)
    prepare(laws, cells, spans, Z, 0, t0, xb)
    for e in range(ne):
        F[0, e] = f[e] = cells[results[law_at(e, operations, laws, cells, xb[e], vb[e])]]
    for k in range(S):
        _without_end_forces(columns, W, G0, X, F, k)
        if ne == 0:
            continue
        place(C, X, k + 1, xa, va)
        prepare(laws, cells, spans, Z, k, t0 + (k + 1) * h, xb)
        if ne < 2 or not _solve_together(
            xa, va, HX, HV, f, operations, results, laws, cells, trial, r, system
        ):
            _solve_in_turn(xa, va, HX, HV, f, operations, results, laws, cells)
        fine = True
        for e in range(ne):
            F[k + 1, e] = f[e]
            for i in range(spans[e, 3] - spans[e, 2]):
                Z[k + 1, spans[e, 2] + i] = cells[results[laws[e, 3] + 3 + i]]
            for i in range(nx):
                X[k + 1, i] -= G1[e, i] * f[e]
        for i in range(nx):
            if not abs(X[k + 1, i]) < 1e100:
                fine = False
        if not fine:
            return k
        place(C, X, k + 1, xb, vb)
    return S


@nb.njit(**UNCOUNTED)
def along(x, v, at, t0, h, operations, steady, results, cells, states, rows, out):
    """Forces out[rows[j]] (N,) of K effects of one kind with states along motions x, v (places, N), of place at[j] each.

    cells (nc, K) of the tape that gives [f, z...]: states and parameters in their places; steady: see tape.Tape.
    """
    cells[3] = h
    play_rows(operations[:steady], cells)
    moving = operations[steady:]
    for k in range(x.shape[1]):
        for j in range(cells.shape[1]):
            cells[0, j], cells[1, j], cells[2, j] = x[at[j], k], v[at[j], k], t0 + k * h
            cells[4, j] = x[at[j], max(k - 1, 0)]
        play_rows(moving, cells)
        for j in range(cells.shape[1]):
            out[rows[j], k] = cells[results[0], j]
            for i in range(states):
                cells[HEAD + i, j] = cells[results[1 + i], j]
