"""trajectory of stepping.run -> its exact derivatives with respect to all parameters at once: one compiled loop.

Arrays of derivatives have one column per parameter (P of them), so that every inner loop runs along memory. Parameter j is
an entry of the mass (kind 0), damping (1), stiffness (2) at row, column; number `row` of the effects' parameters (3); or
state `row` at the first sample (4), which the internal states follow by `follows` (nz,) times the place's displacement.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from sysid_bench.mechanics.stepping import HEAD, law_at, place, prepare, reach

FAST = {"contract", "reassoc", "nsz"}


@nb.njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def _add_product(A, B, out):
    """out += A B, four columns of A at a time: each row of `out` is read and written a quarter as often."""
    rows, inner = A.shape
    P = B.shape[1]
    whole = inner - inner % 4
    for i in range(rows):
        for m in range(0, whole, 4):
            a, b, c, d = A[i, m], A[i, m + 1], A[i, m + 2], A[i, m + 3]
            if a == 0.0 and b == 0.0 and c == 0.0 and d == 0.0:
                continue
            for j in range(P):
                out[i, j] += a * B[m, j] + b * B[m + 1, j] + c * B[m + 2, j] + d * B[m + 3, j]
        for m in range(whole, inner):
            a = A[i, m]
            if a != 0.0:
                for j in range(P):
                    out[i, j] += a * B[m, j]


@nb.njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def _add_matrix_entries(kind, row, column, Bs, Be, X, A, k, dN):
    """What the entries of M, D, K push with: a unit force times acceleration, velocity, displacement."""
    n = A.shape[2]
    nx = 2 * n
    for j in range(len(kind)):
        if kind[j] > 2:
            continue
        r, c = row[j], column[j]
        if kind[j] == 0:
            s0, s1, u0, u1 = A[k, 0, c], A[k, 1, c], A[k, 0, r], A[k, 1, r]
        else:
            at = n if kind[j] == 1 else 0
            s0, s1, u0, u1 = X[k, at + c], X[k + 1, at + c], X[k, at + r], X[k + 1, at + r]
        for i in range(nx):
            dN[i, j] -= Bs[i, r] * s0 + Be[i, r] * s1
        if r != c:
            for i in range(nx):
                dN[i, j] -= Bs[i, c] * u0 + Be[i, c] * u1


@nb.njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def _slopes(e, operations, results, laws, cells, x, v, jac):
    """Fill jac[e] with the Jacobian of law e's force and states, row by row."""
    at = law_at(e, operations, laws, cells, x, v)
    for i in range(laws[e, 4] - at):
        jac[e, i] = cells[results[at + i]]


@nb.njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def _row_of(jac, e, at, spans, kind, row, x, v, b, dZ, out, to):
    """out[to] (P,) = derivative of one result of law e: by its place's motion x, v, b, its states and its parameters."""
    P, first, states = out.shape[1], spans[e, 2], spans[e, 3] - spans[e, 2]
    jx, jv, jb = jac[e, at], jac[e, at + 1], jac[e, at + 4]
    for j in range(P):
        out[to, j] = jx * x[e, j] + jv * v[e, j] + jb * b[e, j]
    for i in range(states):
        w = jac[e, at + HEAD + i]
        for j in range(P):
            out[to, j] += w * dZ[first + i, j]
    for j in range(P):
        if kind[j] == 3 and spans[e, 0] <= row[j] < spans[e, 1]:
            out[to, j] += jac[e, at + HEAD + states + row[j] - spans[e, 0]]


@nb.njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def _solve(jac, HX, HV, system, dF):
    """(I + Jx HX + Jv HV) dF = right-hand side, in place, by elimination without pivots (diagonally dominant)."""
    ne, P = dF.shape
    for e in range(ne):
        for d in range(ne):
            system[e, d] = jac[e, 0] * HX[e, d] + jac[e, 1] * HV[e, d]
        system[e, e] += 1.0
    for e in range(ne):
        for d in range(e + 1, ne):
            w = system[d, e] / system[e, e]
            for i in range(e, ne):
                system[d, i] -= w * system[e, i]
            for j in range(P):
                dF[d, j] -= w * dF[e, j]
    for e in range(ne - 1, -1, -1):
        for d in range(e + 1, ne):
            w = system[e, d]
            for j in range(P):
                dF[e, j] -= w * dF[d, j]
        w = 1.0 / system[e, e]
        for j in range(P):
            dF[e, j] *= w


@nb.njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def _motion_of(C, dX, x, v):
    """x, v (ne, P): derivatives of the places' displacements and velocities."""
    ne, n = C.shape
    P = dX.shape[1]
    for e in range(ne):
        for j in range(P):
            x[e, j] = v[e, j] = 0.0
        for i in range(n):
            w = C[e, i]
            if w != 0.0:
                for j in range(P):
                    x[e, j] += w * dX[i, j]
                    v[e, j] += w * dX[n + i, j]


@nb.njit(cache=True, error_model="numpy", fastmath=FAST, forceinline=True)
def _states_after(jac, spans, HX, HV, kind, row, dF, dZ, x, v, b, out):
    """Derivatives of the internal states at the step's end into out (nz, P); x, v are moved by what dF does."""
    ne, P = dF.shape
    for e in range(ne):
        states = spans[e, 3] - spans[e, 2]
        if states == 0:
            continue
        for d in range(ne):
            hx, hv = HX[e, d], HV[e, d]
            for j in range(P):
                x[e, j] -= hx * dF[d, j]
                v[e, j] -= hv * dF[d, j]
        width = HEAD + states + spans[e, 1] - spans[e, 0]
        for i in range(states):
            _row_of(jac, e, (1 + i) * width, spans, kind, row, x, v, b, dZ, out, spans[e, 2] + i)


@nb.njit(cache=True, error_model="numpy")
def _start(kind, row, C, spans, follows, dX, dZ):
    """Derivatives at the first sample: those of the start itself, and of the internal states that follow it."""
    ne, n = C.shape
    for j in range(len(kind)):
        if kind[j] == 4:
            dX[row[j], j] = 1.0
            for e in range(ne if row[j] < n else 0):
                for i in range(spans[e, 2], spans[e, 3]):
                    dZ[i, j] = follows[i] * C[e, row[j]]


@nb.njit(cache=True, error_model="numpy", fastmath=FAST)
def tangents(
    Ad, G0, G1, Bs, Be, C, X, Z, A, operations, results, laws, cells, spans, t0, h, kind, row, column, follows, keep, out
):  # fmt: skip
    """Derivatives of the trajectory of `run`, all parameters at once; kind, row, column (P,) as above.

    A (S, 2, n): acceleration at the start and end of each step; cells of the slopes' tapes. out (N, ny, P) =
    keep (ny, nx) times the derivative at the N samples.
    """
    S, nx = X.shape[0] - 1, X.shape[1]
    ne = len(C)
    nz, P = Z.shape[1], len(kind)
    nsub = S // (out.shape[0] - 1)
    HX, HV = reach(C, G1)
    ahead, back = -G0.T.copy(), -G1.T.copy()
    dX, dN = np.zeros((nx, P)), np.zeros((nx, P))
    dF, dF1, dZ, dZ1 = np.zeros((ne, P)), np.zeros((ne, P)), np.zeros((nz, P)), np.zeros((nz, P))
    x, v, b, unused = np.zeros((ne, P)), np.zeros((ne, P)), np.zeros((ne, P)), np.zeros((ne, P))
    jac, system = np.zeros((ne, len(results) + HEAD)), np.zeros((ne, ne))
    qb, wb, q, w = np.zeros(ne), np.zeros(ne), np.zeros(ne), np.zeros(ne)
    _start(kind, row, C, spans, follows, dX, dZ)
    out[:] = 0.0
    for k in range(S + 1):
        if k % nsub == 0:
            _add_product(keep, dX, out[k // nsub])
        if k == S:
            break
        dN[:] = 0.0
        _add_product(Ad, dX, dN)
        _add_product(ahead, dF, dN)
        _add_matrix_entries(kind, row, column, Bs, Be, X, A, k, dN)
        place(C, X, k, qb, wb)
        place(C, X, k + 1, q, w)
        prepare(laws, cells, spans, HV, Z, k, t0 + (k + 1) * h, h, qb)
        _motion_of(C, dX, b, unused)
        _motion_of(C, dN, x, v)
        for e in range(ne):
            _slopes(e, operations, results, laws, cells, q[e], w[e], jac)
            _row_of(jac, e, 0, spans, kind, row, x, v, b, dZ, dF1, e)
        _solve(jac, HX, HV, system, dF1)
        _add_product(back, dF1, dN)
        _states_after(jac, spans, HX, HV, kind, row, dF1, dZ, x, v, b, dZ1)
        dX, dN = dN, dX
        dF, dF1 = dF1, dF
        dZ, dZ1 = dZ1, dZ
