"""discrete time -> continuous time and back: the hold's matrices, d2c, difference-equation coefficients."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve

from sysid_bench.mechanics.exponential import exponential
from sysid_bench.nouns import Array, Diverged

Modes = tuple[np.ndarray, np.ndarray, np.ndarray]
NEARLY_DEFECTIVE = 1e6


def c2d_zoh(A: Array, B: Array, h: float) -> tuple[Array, Array]:
    """Ad = exp(A h), Bd = int_0^h exp(A s) ds B, from one exponential (Van Loan 1978)."""
    nx, nu = B.shape
    block = exponential(h * np.block([[A, B], [np.zeros((nu, nx + nu))]]))
    return block[:nx, :nx], block[:nx, nx:]


def difference_equation(Ad: Array, Bd: Array, Cd: Array, Dd: Array) -> tuple[Array, Array]:
    """Coefficients a (nx,) = a1.., b (nx+1,) = b0.. of a single-input, single-output state space."""
    nx = len(Ad)
    a = np.poly(Ad).real
    markov, power = [Dd[0, 0]], Bd
    for _ in range(nx):
        markov.append((Cd @ power)[0, 0])
        power = Ad @ power
    return a[1:], np.convolve(a, markov)[: nx + 1]


def zoh_coefficients(M: Array, D: Array, K: Array, L: Array, C: Array, h: float) -> dict[str, float]:
    """a1.., b0.. of the exact zero-order-hold difference equation of one input and one displacement output.

    M, D, K (n, n), L (n, 1), C (1, n), h in s -> 2n coefficients a and 2n + 1 coefficients b (b0 = 0).
    """
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-solve(M, np.hstack([K, D]), assume_a="pos")]])
    B = np.vstack([np.zeros((n, 1)), solve(M, L, assume_a="pos")])
    Ad, Bd = c2d_zoh(A, B, h)
    a, b = difference_equation(Ad, Bd, np.hstack([C, np.zeros((1, n))]), np.zeros((1, 1)))
    named = {f"a{j + 1}": float(value) for j, value in enumerate(a)}
    return named | {f"b{j}": float(value) for j, value in enumerate(b)}


def separated_eig(A: Array) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues and eigenvectors; a (nearly) defective A is first moved by 1e-10 of its norm.

    That splits a double eigenvalue by about 1e-5: eigenvectors that can be inverted, for an error of 1e-10.
    """
    p, V = np.linalg.eig(A)
    if np.linalg.cond(V) > NEARLY_DEFECTIVE:
        push = np.random.default_rng(0).standard_normal(A.shape)
        p, V = np.linalg.eig(A + 1e-10 * np.linalg.norm(A) * push)
    return p, V


def modes(A: Array, B: Array, C: Array) -> Modes:
    """Eigenvalues p (nx,), output shapes c (ny, nx), input rows b (nx, nu): C (z - A)^-1 B = sum c_k b_k / (z - p_k).

    Raises Diverged for a defective matrix.
    """
    p, V = np.linalg.eig(A)
    try:
        b = np.linalg.solve(V, B.astype(complex))
    except np.linalg.LinAlgError:
        raise Diverged("the state matrix is defective: it has no modal form.") from None
    return p.astype(complex), C @ V, b


def hold_weights(lam: np.ndarray, h: float, hold: str = "zoh") -> np.ndarray:
    """w(lambda) (k,): residue of 1/(s - lambda), sampled behind the hold, at z = exp(lambda h).

    Exact for zoh and foh. For cubic and bandlimited inputs it is that of the cardinal cubic spline, whose own
    (acausal, short) transients at z = -0.268 a rational causal model leaves to its feedthrough.
    """
    p = np.exp(lam * h)
    if hold == "zoh":
        return h * _divided(lam * h)
    centred = h * (np.exp(-lam * h / 2) * _divided(lam * h)) ** (2 if hold == "foh" else 4) * p
    return centred if hold == "foh" else centred / ((p + 4 + 1 / p) / 6)


def _divided(x: np.ndarray) -> np.ndarray:
    """(exp(x) - 1) / x, smooth through x = 0."""
    small = np.abs(x) < 1e-5
    safe = np.where(small, 1.0, x)
    return np.where(small, 1 + x / 2 + x**2 / 6, (np.exp(safe) - 1) / safe)


def continuous_poles(p: np.ndarray, h: float) -> np.ndarray:
    """log(p) / h, rad/s; raises Diverged where a pole sits on the closed negative real axis."""
    on_cut = (np.abs(np.imag(p)) <= 1e-12 * np.abs(p)) & (np.real(p) <= 0)
    if on_cut.any():
        raise Diverged(
            f"a discrete pole at {p[on_cut][0].real:.4g} has no real continuous-time counterpart "
            "(the sampling is too slow for the fastest mode, or the horizon too short)."
        )
    return np.log(p) / h


def d2c(p: np.ndarray, b: np.ndarray, h: float, hold: str = "zoh") -> tuple[np.ndarray, np.ndarray]:
    """Continuous poles lambda (nx,), rad/s, and input rows b (nx, nu) of a discrete modal form."""
    lam = continuous_poles(p, h)
    return lam, b / hold_weights(lam, h, hold)[:, None]
