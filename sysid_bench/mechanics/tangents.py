"""trajectory of stepping.run -> its exact derivatives with respect to all parameters at once: one compiled loop."""

from __future__ import annotations

import numba as nb
import numpy as np

from sysid_bench.mechanics.stepping import HEAD, evaluate_law


@nb.njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"})
def tangents(
    Ad,
    G0,
    G1,
    Bs,
    Be,
    C,
    X,
    F,
    Z,
    A,
    tape,
    p,
    pz,
    nwork,
    nresult,
    t0,
    h,
    kind,
    row,
    column,
    follows,
    keep,
    out,
):
    """Derivatives of the trajectory of `run`, all parameters at once.

    Parameter j is an entry of the mass (kind 0), damping (1), stiffness (2) at row, column; number `row` of
    the effects' parameters (3); or state `row` at the first sample (4), which
    the internal states follow by `follows` (nz,) times the place's displacement. A (S, 2, n): acceleration at
    the start and end of each step. out (N, ny, P) = keep (ny, nx) times the derivative, each `nsub` steps.
    """
    S = X.shape[0] - 1
    nx, n, ne, nz, P = X.shape[1], C.shape[1], C.shape[0], Z.shape[1], len(kind)
    N, ny = out.shape[0], out.shape[1]
    nsub = S // (N - 1)
    HX, HV = np.zeros((ne, ne)), np.zeros((ne, ne))
    for e in range(ne):
        for d in range(ne):
            for i in range(n):
                HX[e, d] += C[e, i] * G1[d, i]
                HV[e, d] += C[e, i] * G1[d, n + i]
    given = np.zeros(HEAD + len(p) + nz)
    work, result = np.zeros(nwork), np.zeros(nresult)
    dX, dN = np.zeros((nx, P)), np.zeros((nx, P))
    dF, dF1, dZ = np.zeros((ne, P)), np.zeros((ne, P)), np.zeros((nz, P))
    dZ1 = np.zeros((nz, P))
    xb, xn, vn = np.zeros((ne, P)), np.zeros((ne, P)), np.zeros((ne, P))
    jac = np.zeros((ne, nresult))
    system = np.zeros((ne, ne))
    for j in range(P):
        if kind[j] == 4:
            dX[row[j], j] = 1.0
            if row[j] < n:
                for e in range(ne):
                    for i in range(pz[e, 2], pz[e, 3]):
                        dZ[i, j] = follows[i] * C[e, row[j]]
    for k in range(S + 1):
        if k % nsub == 0:
            for c in range(ny):
                for j in range(P):
                    s = 0.0
                    for i in range(nx):
                        s += keep[c, i] * dX[i, j]
                    out[k // nsub, c, j] = s
        if k == S:
            break
        dN[:] = 0.0
        for i in range(nx):
            for m in range(nx):
                w = Ad[i, m]
                for j in range(P):
                    dN[i, j] += w * dX[m, j]
            for e in range(ne):
                w = G0[e, i]
                for j in range(P):
                    dN[i, j] -= w * dF[e, j]
        for j in range(P):
            if kind[j] < 3:
                r, c = row[j], column[j]
                if kind[j] == 0:
                    s0, s1, u0, u1 = A[k, 0, c], A[k, 1, c], A[k, 0, r], A[k, 1, r]
                elif kind[j] == 1:
                    s0, s1, u0, u1 = X[k, n + c], X[k + 1, n + c], X[k, n + r], X[k + 1, n + r]
                else:
                    s0, s1, u0, u1 = X[k, c], X[k + 1, c], X[k, r], X[k + 1, r]
                for i in range(nx):
                    dN[i, j] -= Bs[i, r] * s0 + Be[i, r] * s1
                if r != c:
                    for i in range(nx):
                        dN[i, j] -= Bs[i, c] * u0 + Be[i, c] * u1
        for e in range(ne):
            x = v = b = 0.0
            for i in range(n):
                x += C[e, i] * X[k + 1, i]
                v += C[e, i] * X[k + 1, n + i]
                b += C[e, i] * X[k, i]
            given[0], given[1], given[2], given[3], given[4], given[5] = (
                x,
                v,
                t0 + (k + 1) * h,
                h,
                b,
                HV[e, e],
            )
            evaluate_law(e, tape, given, p, pz, Z[k], work, result)
            jac[e] = result
            for j in range(P):
                xb[e, j] = xn[e, j] = vn[e, j] = 0.0
            for i in range(n):
                w = C[e, i]
                if w != 0.0:
                    for j in range(P):
                        xb[e, j] += w * dX[i, j]
                        xn[e, j] += w * dN[i, j]
                        vn[e, j] += w * dN[n + i, j]
            z_first, z_count = pz[e, 2], pz[e, 3] - pz[e, 2]
            for j in range(P):
                s = jac[e, 0] * xn[e, j] + jac[e, 1] * vn[e, j] + jac[e, 4] * xb[e, j]
                for i in range(z_count):
                    s += jac[e, HEAD + i] * dZ[z_first + i, j]
                if kind[j] == 3 and pz[e, 0] <= row[j] < pz[e, 1]:
                    s += jac[e, HEAD + z_count + row[j] - pz[e, 0]]
                dF1[e, j] = s
        # (I + Jx HX + Jv HV) dF1 = right-hand side, by elimination without pivots (diagonally dominant)
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
                    dF1[d, j] -= w * dF1[e, j]
        for e in range(ne - 1, -1, -1):
            for d in range(e + 1, ne):
                for j in range(P):
                    dF1[e, j] -= system[e, d] * dF1[d, j]
            w = 1.0 / system[e, e]
            for j in range(P):
                dF1[e, j] *= w
        for e in range(ne):
            for i in range(nx):
                w = G1[e, i]
                for j in range(P):
                    dN[i, j] -= w * dF1[e, j]
        for e in range(ne):
            z_first, z_count = pz[e, 2], pz[e, 3] - pz[e, 2]
            if z_count == 0:
                continue
            width = HEAD + z_count + pz[e, 1] - pz[e, 0]
            for i in range(z_count):
                base = (1 + i) * width
                for j in range(P):
                    x = xn[e, j]
                    v = vn[e, j]
                    for d in range(ne):
                        x -= HX[e, d] * dF1[d, j]
                        v -= HV[e, d] * dF1[d, j]
                    s = jac[e, base] * x + jac[e, base + 1] * v + jac[e, base + 4] * xb[e, j]
                    for m in range(z_count):
                        s += jac[e, base + HEAD + m] * dZ[z_first + m, j]
                    if kind[j] == 3 and pz[e, 0] <= row[j] < pz[e, 1]:
                        s += jac[e, base + HEAD + z_count + row[j] - pz[e, 0]]
                    dZ1[z_first + i, j] = s
        for i in range(nz):
            for j in range(P):
                dZ[i, j] = dZ1[i, j]
        for e in range(ne):
            for j in range(P):
                dF[e, j] = dF1[e, j]
        for i in range(nx):
            for j in range(P):
                dX[i, j] = dN[i, j]
