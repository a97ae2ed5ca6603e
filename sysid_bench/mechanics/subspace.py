"""u, y -> discrete modal form of order nx: PO-MOESP or CVA for A, C; least squares on the simulation for B, x0, D.

Verhaegen, Automatica 30 (1994) 61-74; Van Overschee and De Moor, Subspace Identification (1996), chapter 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag
from scipy.signal import lfilter

from sysid_bench.mechanics.conversion import continuous_poles, separated_eig
from sysid_bench.mechanics.hankel import order_rows, triangular_factor
from sysid_bench.mechanics.rules import rule
from sysid_bench.nouns import Array, Diverged, NotApplicable

WEIGHTS = ("moesp", "cva")
REAL_POLE = 1e-9


@dataclass(frozen=True, eq=False)
class HalfModes:
    """Discrete poles p (k,) and output shapes c (ny, k); of each conjugate pair the one above the real axis.

    weight (k,): 2 for a pair, 1 for a real pole: y = sum_k weight_k Re(c_k z_k). reflected: unstable poles
    that were mirrored at the unit circle.
    """

    p: np.ndarray
    c: np.ndarray
    weight: Array
    reflected: int = 0

    @property
    def real(self) -> np.ndarray:
        return self.weight == 1.0

    def full(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(p, c, rows) with the conjugates; rows (k, m) belong to the modes, as b does."""
        pair = ~self.real
        return (
            np.concatenate([self.p, self.p[pair].conj()]),
            np.concatenate([self.c, self.c[:, pair].conj()], axis=1),
            np.concatenate([rows, rows[pair].conj()]),
        )


def half_modes(A: Array, C: Array) -> HalfModes:
    """Modal form of (A, C); a pole outside the unit circle is replaced by its mirror image."""
    p, V = separated_eig(A)
    outside = np.abs(p) >= 1
    p = np.where(outside, 1 / np.where(outside, p, 1).conj(), p).astype(complex)
    real = np.abs(np.imag(p)) <= REAL_POLE * np.abs(p)
    keep = (np.imag(p) > 0) | real
    c = C @ V.astype(complex)
    c = c / c[np.abs(c).argmax(axis=0), np.arange(c.shape[1])]
    return HalfModes(p[keep], c[:, keep], np.where(real[keep], 1.0, 2.0), int(outside.sum()))


def observability(R: Array, nu: int, ny: int, i: int, weight: str) -> tuple[Array, Array]:
    """Extended observability candidates U sqrt(S) (i ny, i ny) and singular values, of the triangular factor R."""
    past, future = slice(i * nu, 2 * i * nu + i * ny), slice(2 * i * nu + i * ny, None)
    R32 = R[future, past]
    if weight == "moesp":
        U, s, _ = np.linalg.svd(R32, full_matrices=False)
        return U * np.sqrt(s), s
    # CVA: whiten the future outputs, given the future inputs, first.
    values, V = np.linalg.eigh(R[future, past.start :] @ R[future, past.start :].T)
    root = np.sqrt(np.maximum(values, 1e-12 * values[-1]))
    U, s, _ = np.linalg.svd((V / root) @ (V.T @ R32), full_matrices=False)
    return (V * root) @ (V.T @ U) * np.sqrt(s), s


def choose_order(singular_values: Array, largest: int) -> int:
    """The order before the widest gap on a log scale, at most `largest`."""
    s = np.log(np.maximum(singular_values[: largest + 1], 1e-300))
    return int(np.argmax(s[:-1] - s[1:])) + 1


def shift_invariance(Gamma: Array, ny: int) -> tuple[Array, Array]:
    """A (nx, nx), C (ny, nx) of an extended observability matrix (i ny, nx)."""
    return np.linalg.lstsq(Gamma[:-ny], Gamma[ny:], rcond=None)[0], Gamma[:ny]


def check_sizes(N: int, nu: int, ny: int, i: int, nx: int) -> None:
    """Raises NotApplicable where the horizon is too short for the order or the record for the horizon."""
    if (i - 1) * ny < nx:
        raise NotApplicable(
            f"horizon {i} is too short: order {nx} with {ny} outputs needs {-(-nx // ny) + 1}."
        )
    if N - 2 * i + 1 < 2 * i * (nu + ny):
        raise NotApplicable(
            f"{N} samples are too few for a horizon of {i}: {2 * i * (nu + ny) + 2 * i - 1} are needed."
        )


def hold_drives(modes: HalfModes, u: Array, h: float, hold: str) -> np.ndarray:
    """(k, N-1, nu): what the input adds to each mode per step behind the hold, of a unit continuous input row.

    A band-limited input is taken as its cubic spline.
    """
    chosen = rule("cubic" if hold == "bandlimited" else hold)
    weights = h * chosen.functions(continuous_poles(modes.p, h) * h)[1:]
    return np.einsum("pk,ptu->ktu", weights, chosen.coefficients(u))


def modal_states(modes: HalfModes, u: Array, drives: np.ndarray | None) -> np.ndarray:
    """xi (N, k, nu + 1): each mode's response to each input, then to a unit initial state."""
    N, nu = u.shape
    xi = np.zeros((N, len(modes.p), nu + 1), dtype=complex)
    for k, p in enumerate(modes.p):
        drive = u[:-1] if drives is None else drives[k]
        xi[1:, k, :nu] = lfilter([1.0], [1.0, -p], drive, axis=0)
        xi[:, k, nu] = p ** np.arange(N)
    return xi


@dataclass(frozen=True, eq=False)
class InputFit:
    """Rows beta (k, nu + 1) = [b, x0] of the modes by least squares on the simulated output.

    normal: matrix of the least squares; xi (N, k (nu+1)): its complex regressors without output shapes;
    residual (N, ny); feedthrough (ny, nu) or None.
    """

    beta: np.ndarray
    normal: Array
    xi: np.ndarray
    residual: Array
    feedthrough: Array | None


def _real_columns(modes: HalfModes, q: int) -> np.ndarray:
    """Which of [Re beta, Im beta] are unknowns: real modes have no imaginary part."""
    return np.concatenate([np.ones(len(modes.p) * q, dtype=bool), np.repeat(~modes.real, q)])


def normal_matrix(modes: HalfModes, gram: Array, q: int) -> Array:
    """Sum over outputs of J_o^T J_o, J_o = [Re, -Im] of weight_k c_ok xi_kj, from the Gram of [Re xi, Im xi].

    As the shapes enter by products only, it is the Gram matrix times (C^H C) and (C^T C) entry by entry.
    """
    size = len(modes.p) * q
    a, b, d = gram[:size, :size], gram[:size, size:], gram[size:, size:]
    shapes = np.repeat(modes.c * modes.weight, q, axis=1)
    hermitian = (shapes.conj().T @ shapes) * (a + d + 1j * (b - b.T))
    bilinear = (shapes.T @ shapes) * (a - d + 1j * (b + b.T))
    RR, II = (hermitian + bilinear).real / 2, (hermitian - bilinear).real / 2
    RI = (hermitian + bilinear).imag / 2
    return np.block([[RR, -RI], [-RI.T, II]])


def gradient(modes: HalfModes, products: np.ndarray, q: int) -> Array:
    """Sum over outputs of J_o^T r_o from products (k q, ny) = xi^T r."""
    shapes = np.repeat(modes.c * modes.weight, q, axis=1)
    g = (shapes.T * products).sum(axis=1)
    return np.concatenate([g.real, -g.imag])


def solve_rows(modes: HalfModes, normal: Array, gradients: Array, q: int) -> np.ndarray:
    """beta (R, k, q) complex of normal [Re; Im] = g, gradients (R, 2 k q); of minimal norm where it is singular."""
    used = _real_columns(modes, q)
    H = normal[np.ix_(used, used)]
    scale = np.sqrt(np.maximum(np.diag(H), np.finfo(float).tiny))
    right = (gradients[:, used] / scale).T
    solution = np.zeros(gradients.shape)
    solution[:, used] = np.linalg.lstsq(H / np.outer(scale, scale), right, rcond=1e-13)[0].T / scale
    half = len(used) // 2
    return (solution[:, :half] + 1j * solution[:, half:]).reshape(len(gradients), -1, q)


def fit_inputs(
    modes: HalfModes,
    u: Array,
    y: Array,
    feedthrough: bool,
    drives: np.ndarray | None = None,
    keep: Array | None = None,
) -> InputFit:
    """b, x0 and, where asked for, the feedthrough, all outputs at once.

    drives None: b is discrete, x(k+1) = p x(k) + b u(k); else as hold_drives, and b is continuous.
    keep (N,): the samples that count, all where None.
    """
    q = u.shape[1] + 1
    xi = modal_states(modes, u, drives).reshape(len(y), -1)
    if keep is not None:
        xi, u, y = xi[keep], u[keep], y[keep]
    columns, target = np.hstack([np.real(xi), np.imag(xi)]), y
    if feedthrough:  # by projecting u out of everything (Frisch-Waugh)
        through = np.linalg.lstsq(u, np.hstack([columns, y]), rcond=None)[0]
        columns, target = columns - u @ through[:, : -y.shape[1]], y - u @ through[:, -y.shape[1] :]
    half = xi.shape[1]
    products = columns.T @ target
    normal = normal_matrix(modes, columns.T @ columns, q)
    g = gradient(modes, products[:half] + 1j * products[half:], q)
    beta = solve_rows(modes, normal, g[None], q)[0]
    coefficients = (np.repeat(modes.c * modes.weight, q, axis=1) * beta.ravel()).T
    residual = y - np.real(xi) @ np.real(coefficients) + np.imag(xi) @ np.imag(coefficients)
    Dd = np.linalg.lstsq(u, residual, rcond=None)[0] if feedthrough else None
    if Dd is not None:
        residual = residual - u @ Dd
        xi = columns[:, :half] + 1j * columns[:, half:]
    return InputFit(beta, normal, xi, residual, None if Dd is None else Dd.T)


def identify_modes(
    z: Array, nu: int, i: int, nx: int | None, weight: str, largest: int
) -> tuple[HalfModes, Array]:
    """(A, C) of scaled z = [u y] (N, nu + ny), and the singular values. nx None: by the widest gap.

    Raises Diverged where the state matrix is not finite.
    """
    ny = z.shape[1] - nu
    R = triangular_factor(z, order_rows(nu, ny, i), 2 * i)
    Gamma, s = observability(R, nu, ny, i, weight)
    nx = choose_order(s, min(largest, (i - 1) * ny - 1)) if nx is None else nx
    modes = half_modes(*shift_invariance(Gamma[:, :nx], ny))
    if not np.all(np.isfinite(modes.c)):
        raise Diverged("the subspace step gave a state matrix that is not finite.")
    return modes, s


def real_state_space(modes: HalfModes, b: np.ndarray) -> tuple[Array, Array, Array]:
    """A (nx, nx), B (nx, nu), C (ny, nx) with 2x2 rotations for pairs, from half modes and rows b (k, nu)."""
    A, B, C = [], [], []
    for p, c, row, weight in zip(modes.p, modes.c.T, b, modes.weight):
        pair = weight == 2.0
        A.append(np.array([[p.real, -p.imag], [p.imag, p.real]]) if pair else np.array([[p.real]]))
        B.append(np.array([row.real, row.imag]) if pair else row.real[None])
        C.append(2 * np.array([c.real, -c.imag]).T if pair else c.real[:, None])
    return block_diag(*A), np.vstack(B), np.hstack(C)


def default_horizon(N: int, nu: int, ny: int, nx: int) -> int:
    """20 for up to 3 outputs, 12 from 5 on; less where the record is short, never below what the order needs."""
    affordable = (N + 1) // (2 * (nu + ny) + 2)
    return max(min(20, max(12, 60 // ny), affordable), -(-nx // ny) + 1)
