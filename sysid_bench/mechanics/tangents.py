"""trajectory of stepping.run -> its exact derivatives with respect to all parameters at once: one compiled loop.

Arrays of derivatives have one column per parameter (P of them), so that every inner loop runs along memory. Parameter j is
an entry of the mass (kind 0), damping (1), stiffness (2) at row, column; number `row` of the effects' parameters (3); or
state `row` at the first sample (4), which the internal states follow by `follows` (nz,) times the place's displacement.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from sysid_bench.mechanics.compiled import UNCOUNTED
from sysid_bench.mechanics.stepping import HEAD, law_at, place, prepare, reach, settle

FAST = {"contract", "reassoc", "nsz"}
BLOCK = 16  # samples that are put out together: each variable's own lie next to each other in memory


@nb.njit(**UNCOUNTED, fastmath=FAST, forceinline=True)
def _add_product(A, B, out):
    """out += A B, by blocks of two rows and four columns of A: each row of B and of `out` is read less often."""
    rows, inner = A.shape
    P = out.shape[1]
    whole, even = inner - inner % 4, rows - rows % 2
    for m in range(0, whole, 4):
        for i in range(0, even, 2):
            a, b, c, d = A[i, m], A[i, m + 1], A[i, m + 2], A[i, m + 3]
            e, f, g, h = A[i + 1, m], A[i + 1, m + 1], A[i + 1, m + 2], A[i + 1, m + 3]
            if a == b == c == d == e == f == g == h == 0.0:
                continue
            for j in range(P):
                B0, B1, B2, B3 = B[m, j], B[m + 1, j], B[m + 2, j], B[m + 3, j]
                out[i, j] += a * B0 + b * B1 + c * B2 + d * B3
                out[i + 1, j] += e * B0 + f * B1 + g * B2 + h * B3
        for i in range(even, rows):
            a, b, c, d = A[i, m], A[i, m + 1], A[i, m + 2], A[i, m + 3]
            for j in range(P):
                out[i, j] += a * B[m, j] + b * B[m + 1, j] + c * B[m + 2, j] + d * B[m + 3, j]
    for m in range(whole, inner):
        for i in range(rows):
            a = A[i, m]
            if a != 0.0:
                for j in range(P):
                    out[i, j] += a * B[m, j]


@nb.njit(**UNCOUNTED, fastmath=FAST, forceinline=True)
def _add_matrix_entries(entries, arms, X, A, k, shown, dN):
    """What the entries of M, D, K push with: a unit force times acceleration, velocity, displacement.

    entries (E, 2): where the factors of the unit forces at the row and at the column stand in [a, q, v];
    arms (2, 2, nx, E): what these forces do, the falling one and the rising one; shown (2, 2, E): to work in
    """
    n, E = A.shape[2], len(entries)
    for side in range(2):
        for end in range(2):
            for j in range(E):
                at = entries[j, side]
                shown[side, end, j] = A[k, end, at] if at < n else X[k + end, at - n]
    for side in range(2):
        for i in range(2 * n):
            for j in range(E):
                dN[i, j] -= arms[side, 0, i, j] * shown[side, 0, j] + arms[side, 1, i, j] * shown[side, 1, j]


@nb.njit(**UNCOUNTED, fastmath=FAST, forceinline=True)
def _slopes(e, operations, results, laws, cells, x, v, jac):
    """Fill jac[e] with the Jacobian of law e's force and states, row by row."""
    at = law_at(e, operations, laws, cells, x, v)
    for i in range(laws[e, 4] - at):
        jac[e, i] = cells[results[at + i]]


@nb.njit(**UNCOUNTED, fastmath=FAST, forceinline=True)
def _row_of(jac, e, at, spans, own, row, x, v, b, dZ, out, to):
    """out[to] (P,) = derivative of one result of law e: by its place's motion x, v, b, its states and its parameters."""
    P, first, states = out.shape[1], spans[e, 2], spans[e, 3] - spans[e, 2]
    jx, jv, jb = jac[e, at], jac[e, at + 1], jac[e, at + 4]
    for j in range(P):
        out[to, j] = jx * x[e, j] + jv * v[e, j] + jb * b[e, j]
    for i in range(states):
        w = jac[e, at + HEAD + i]
        for j in range(P):
            out[to, j] += w * dZ[first + i, j]
    for j in own:
        if spans[e, 0] <= row[j] < spans[e, 1]:
            out[to, j] += jac[e, at + HEAD + states + row[j] - spans[e, 0]]


@nb.njit(**UNCOUNTED, fastmath=FAST, forceinline=True)
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


@nb.njit(**UNCOUNTED, fastmath=FAST, forceinline=True)
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


@nb.njit(**UNCOUNTED, fastmath=FAST, forceinline=True)
def _states_after(jac, spans, HX, HV, own, row, dF, dZ, x, v, b, out):
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
            _row_of(jac, e, (1 + i) * width, spans, own, row, x, v, b, dZ, out, spans[e, 2] + i)


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


@nb.njit(cache=True, error_model="numpy")
def _arms(kind, row, column, Bs, Be, n):
    """entries (E, 2) and arms (2, 2, nx, E) as in _add_matrix_entries."""
    E = int((kind < 3).sum())
    entries, arms = np.zeros((E, 2), dtype=np.int64), np.zeros((2, 2, 2 * n, E))
    for j in range(E):
        r, c = row[j], column[j]
        block = (0, 2 * n, n)[kind[j]]
        entries[j, 0], entries[j, 1] = block + c, block + r
        arms[0, 0, :, j], arms[0, 1, :, j] = Bs[:, r], Be[:, r]
        if r != c:
            arms[1, 0, :, j], arms[1, 1, :, j] = Bs[:, c], Be[:, c]
    return entries, arms


@nb.njit(cache=True, error_model="numpy")
def tangents(
    Ad, G0, G1, Bs, Be, C, X, Z, A, operations, results, laws, cells, spans, t0, h, kind, row, column, follows, keep, out
):  # fmt: skip
    """Derivatives of the trajectory of `run`, all parameters at once; kind, row, column (P,) as above, entries first.

    A (S, 2, n): acceleration at the start and end of each step; cells of the slopes' tapes. out (ny, P, N) =
    keep (ny, nx) times the derivative at the N samples.
    """
    nx, (ne, n), nz, P = X.shape[1], C.shape, Z.shape[1], len(kind)
    HX, HV = reach(C, G1)
    entries, arms = _arms(kind, row, column, Bs, Be, n)
    dX, dN = np.zeros((nx, P)), np.zeros((nx, P))
    dF, dF1, dZ, dZ1 = np.zeros((ne, P)), np.zeros((ne, P)), np.zeros((nz, P)), np.zeros((nz, P))
    x, v, b, unused = np.zeros((ne, P)), np.zeros((ne, P)), np.zeros((ne, P)), np.zeros((ne, P))
    jac, system = np.zeros((ne, len(results) + HEAD)), np.zeros((ne, ne))
    qb, wb, q, w = np.zeros(ne), np.zeros(ne), np.zeros(ne), np.zeros(ne)
    _start(kind, row, C, spans, follows, dX, dZ)
    _march(
        Ad, -G0.T.copy(), -G1.T.copy(), entries, arms, C, HX, HV, X, Z, A, operations, results, laws, cells, spans, t0, h,
        np.flatnonzero(kind == 3), row, keep, out,
        np.zeros((BLOCK, len(keep), P)), np.zeros((2, 2, len(entries))), dX, dN, dF, dF1, dZ, dZ1, x, v, b, unused, jac, system, qb, wb, q, w,
    )  # fmt: skip


@nb.njit(**UNCOUNTED, fastmath=FAST, forceinline=True)
def _put_out(block, end, out):
    """The block's samples, the last of which is before `end`, into out; the block is zero again."""
    first = (end - 1) // BLOCK * BLOCK
    for i in range(block.shape[1]):
        for j in range(block.shape[2]):
            for k in range(first, end):
                out[i, j, k] = block[k - first, i, j]
    block[:] = 0.0


@nb.njit(**UNCOUNTED, fastmath=FAST)
def _march(
    Ad, ahead, back, entries, arms, C, HX, HV, X, Z, A, operations, results, laws, cells, spans, t0, h, own, row, keep, out,
    block, shown, dX, dN, dF, dF1, dZ, dZ1, x, v, b, unused, jac, system, qb, wb, q, w,
):  # fmt: skip
    """All steps of the derivatives; from `block` on arrays to work in (see stepping._steps)."""
    S, (nx, P), ne = len(X) - 1, dX.shape, len(C)
    nsub = S // (out.shape[2] - 1)
    settle(operations, laws, cells, HV, h)
    for k in range(S + 1):
        if k % nsub == 0:
            _add_product(keep, dX, block[k // nsub % BLOCK])
            if k == S or k // nsub % BLOCK == BLOCK - 1:
                _put_out(block, k // nsub + 1, out)
        if k == S:
            break
        for i in range(nx):
            for j in range(P):
                dN[i, j] = 0.0
        _add_product(Ad, dX, dN)
        _add_product(ahead, dF, dN)
        _add_matrix_entries(entries, arms, X, A, k, shown, dN)
        place(C, X, k, qb, wb)
        place(C, X, k + 1, q, w)
        prepare(laws, cells, spans, Z, k, t0 + (k + 1) * h, qb)
        _motion_of(C, dX, b, unused)
        _motion_of(C, dN, x, v)
        for e in range(ne):
            _slopes(e, operations, results, laws, cells, q[e], w[e], jac)
            _row_of(jac, e, 0, spans, own, row, x, v, b, dZ, dF1, e)
        _solve(jac, HX, HV, system, dF1)
        _add_product(back, dF1, dN)
        _states_after(jac, spans, HX, HV, own, row, dF1, dZ, x, v, b, dZ1)
        dX, dN = dN, dX
        dF, dF1 = dF1, dF
        dZ, dZ1 = dZ1, dZ
