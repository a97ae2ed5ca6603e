"""M, D, K, L, C -> theta, state space, poles, modes. The algebra of M q'' + D q' + K q = L u, y = C q."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from sysid_bench.nouns import OUTPUTS, Array, Complex, InputError, Model

# Eigenvectors conditioned worse than this (rows equilibrated) count as defective: critical damping, rigid body.
# Sensitivities lose the square of it: 1e4 leaves 1e-8.
DEFECTIVE_CONDITION = 1e4


def ntheta(n: int) -> int:
    """Free entries of three symmetric (n, n) matrices."""
    return 3 * n * (n + 1) // 2


@lru_cache(maxsize=64)
def upper(n: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns, (n (n + 1)/2,) each, of the upper triangle by rows, as theta has them."""
    return np.triu_indices(n)


def pairs(n: int) -> list[tuple[int, int]]:
    """The (i, j), i <= j, of each entry of one matrix, in the order of pack."""
    return [(int(i), int(j)) for i, j in zip(*upper(n))]


def pack(M: Array, D: Array, K: Array) -> Array:
    """theta (3 n (n+1)/2,): upper triangles by rows, M then D then K."""
    rows, cols = upper(len(M))
    return np.concatenate([np.asarray(X)[rows, cols] for X in (M, D, K)])


def unpack(theta: Array, n: int) -> tuple[Array, Array, Array]:
    """The inverse of pack: symmetric M, D, K (n, n)."""
    rows, cols = upper(n)
    X = np.zeros((3, n, n))
    X[:, rows, cols] = np.reshape(theta, (3, -1))
    X[:, cols, rows] = X[:, rows, cols]
    return X[0], X[1], X[2]


def free_mask(model: Model) -> NDArray[np.bool_]:
    """Which entries of theta the model leaves to be estimated, (ntheta,) bool."""
    everything = np.ones((model.n, model.n), dtype=bool)
    masks = [model.free.get(name, everything) for name in ("mass", "damping", "stiffness")]
    rows, cols = upper(model.n)
    return np.concatenate([mask[rows, cols] for mask in masks])


def companion(M: Array, D: Array, K: Array) -> Array:
    """A (2n, 2n) of x' = A x for x = [q; q'] (Bruschetta 2011, (1.4))."""
    n = len(M)
    return np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), -np.linalg.solve(M, np.hstack([K, D]))])


def input_matrix(M: Array, L: Array) -> Array:
    """B (2n, nu) of x' = A x + B u for x = [q; q']."""
    return np.vstack([np.zeros_like(L), np.linalg.solve(M, L)])


def output_matrices(A: Array, B: Array, C: Array, output: str) -> tuple[Array, Array]:
    """(ny, 2n) and (ny, nu) that read displacement, velocity or acceleration from x = [q; q'] and u.

    Raises InputError for another output.
    """
    n, zero = len(A) // 2, np.zeros((len(C), B.shape[1]))
    if output == "displacement":
        return np.hstack([C, np.zeros_like(C)]), zero
    if output == "velocity":
        return np.hstack([np.zeros_like(C), C]), zero
    if output == "acceleration":
        return C @ A[n:], C @ B[n:]
    raise InputError(f"output must be one of {', '.join(OUTPUTS)}; got {output!r}.")


def state_space(
    M: Array, D: Array, K: Array, L: Array | None = None, C: Array | None = None, output: str = "displacement"
) -> tuple[Array, Array, Array, Array]:
    """Continuous (A, B, Cx, Dx) of M q'' + D q' + K q = L u with x = [q; q']; L, C identity where None."""
    eye = np.eye(len(M))
    A, B = companion(M, D, K), input_matrix(M, eye if L is None else np.asarray(L, float))
    return A, B, *output_matrices(A, B, eye if C is None else np.asarray(C, float), output)


def pole_order(poles: Complex) -> NDArray[np.intp]:
    """Indices (k,) that sort by magnitude, then real part; of a pair the positive imaginary part first."""
    scale = np.abs(poles).max(initial=0) or 1.0
    return np.lexsort((-poles.imag, poles.real, np.round(np.abs(poles) / scale, 9)))


def sort_poles(poles: Complex) -> Complex:
    """The poles in pole_order."""
    poles = np.asarray(poles, dtype=complex)
    return poles[pole_order(poles)]


def poles(M: Array, D: Array, K: Array) -> Complex:
    """The 2n poles, rad/s, sorted by sort_poles."""
    return sort_poles(np.linalg.eigvals(companion(M, D, K)))


def frequencies_and_damping(poles: Complex) -> tuple[Array, Array]:
    """omega_n (rad/s) and zeta, one entry per complex pair and one per real pole (zeta 1, or -1 if unstable).

    A pole at zero (rigid body) has omega_n = 0 and zeta = 0.
    """
    half = sort_poles(poles)
    half = half[half.imag >= 0]
    omega_n = np.abs(half)
    return omega_n, np.divide(-half.real, omega_n, out=np.zeros_like(omega_n), where=omega_n > 0)


def undamped_modes(M: Array, K: Array) -> tuple[Array, Array]:
    """omega_n (n,) rad/s and mass-normalised shapes (n, n), columns phi: K phi = omega_n^2 M phi."""
    squares, shapes = eigh(K, M)
    return np.sqrt(np.maximum(squares, 0.0)), shapes


class Modes(NamedTuple):
    """A = V diag(lam) W, W = V^-1, of each conjugate pair one: x = Re sum_k weight_k V_k z_k, z = W x.

    lam (nm,) rad/s; V (2n, nm); W (nm, 2n); weight (nm,): 2 for a pair, 1 for a real pole;
    condition of the eigenvectors with rows equilibrated. W is NaN where `defective`.
    """

    lam: Complex
    V: Complex
    W: Complex
    weight: Array
    condition: float

    @property
    def defective(self) -> bool:
        return not self.condition < DEFECTIVE_CONDITION


def modes(A: Array) -> Modes:
    """Modal decomposition of a real A; look at `.defective` before using it."""
    lam, V = np.linalg.eig(A)
    lam, V = lam.astype(complex), V.astype(complex)
    equilibrated = V / np.maximum(np.linalg.norm(V, axis=1, keepdims=True), np.finfo(float).tiny)
    condition = float(np.linalg.cond(equilibrated))
    W = np.linalg.inv(V) if condition < DEFECTIVE_CONDITION else np.full_like(V, np.nan)
    half = np.imag(lam) >= 0
    weight = np.where(np.imag(lam[half]) > 0, 2.0, 1.0)
    return Modes(lam[half], V[:, half], W[half], weight, condition)
