"""m, c, k, T -> the difference-equation coefficients as Kapucu and Baysec (1997) print them, and corrected.

y(k) + a1 y(k-1) + a2 y(k-2) = b0 u(k) + b1 u(k-1) + b2 u(k-2) of m y'' + c y' + k y = u under a zero-order
hold of T seconds. `conversion.zoh_coefficients` has the same numbers from one matrix exponential, without the
branches: c = 2 sqrt(6) with k m = 6 is critically damped, and lands in the underdamped branch by rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid_bench.mechanics.conversion import zoh_coefficients

Coefficients = dict[str, float]


def _coefficients(a1: float, a2: float, b1: float, b2: float) -> Coefficients:
    return {"a1": float(a1), "a2": float(a2), "b0": 0.0, "b1": float(b1), "b2": float(b2)}


def undamped(m: float, k: float, T: float) -> Coefficients:
    """Eq. (25), as printed."""
    cosine = np.cos(np.sqrt(k / m) * T)
    return _coefficients(-2 * cosine, 1.0, (1 - cosine) / k, (1 - cosine) / k)


def underdamped(m: float, c: float, k: float, T: float, *, printed: bool = False) -> Coefficients:
    """Eq. (36), corrected: b2 starts with exp(-bT). With `printed` as in the paper, which has 1 there."""
    b = c / (2 * m)
    omega_d = np.sqrt(k / m - b**2)
    e, cosine, sine = np.exp(-b * T), np.cos(omega_d * T), b / omega_d * np.sin(omega_d * T)
    first = 1.0 if printed else e
    return _coefficients(
        -2 * e * cosine, e**2, (1 - e * (cosine + sine)) / k, e * (first - cosine + sine) / k
    )


def critically_damped(m: float, k: float, T: float) -> Coefficients:
    """Eq. (39), as printed; c = 2 sqrt(k m)."""
    x = np.sqrt(k / m) * T
    e = np.exp(-x)
    return _coefficients(-2 * e, e**2, (1 - e * (1 + x)) / k, (e**2 - e * (1 - x)) / k)


def overdamped(m: float, c: float, k: float, T: float) -> Coefficients:
    """Eqs. (42) and (43), as printed."""
    root = np.sqrt(c**2 / (4 * m**2) - k / m)
    p, q = c / (2 * m) + root, c / (2 * m) - root
    ep, eq = np.exp(-p * T), np.exp(-q * T)
    over_p, over_q = 1 / (m * p * (q - p)), 1 / (m * q * (q - p))
    b1 = -(eq + ep) / k + (1 + eq) * over_p - (1 + ep) * over_q
    return _coefficients(-eq - ep, ep * eq, b1, ep * eq / k - eq * over_p + ep * over_q)


def closed_form(m: float, c: float, k: float, T: float) -> Coefficients:
    """The branch that the sign of c^2 - 4 k m selects, (36) corrected."""
    if c == 0:
        return undamped(m, k, T)
    if c**2 == 4 * k * m:
        return critically_damped(m, k, T)
    return underdamped(m, c, k, T) if c**2 < 4 * k * m else overdamped(m, c, k, T)


def exact(m: float, c: float, k: float, T: float) -> Coefficients:
    """The same coefficients from the matrix exponential."""
    M, D, K = (np.array([[x]]) for x in (m, c, k))
    return zoh_coefficients(M, D, K, np.eye(1), np.eye(1), T)


@dataclass(frozen=True)
class Misprint:
    """One misprint: where, what is meant, and one number as printed, as corrected and as it is, at (m, c, k, T).

    `printed`, `corrected`, `exact` are functions (m, c, k, T) -> float, exact from first principles. `checked` is
    False where it is a matter of wording that no number can show (the functions are then absent).
    """

    equation: str
    printed_text: str
    corrected_text: str
    quantity: str = ""
    printed: Callable[[float, float, float, float], float] | None = None
    corrected: Callable[[float, float, float, float], float] | None = None
    exact: Callable[[float, float, float, float], float] | None = None

    @property
    def checked(self) -> bool:
        return self.exact is not None


def _poles(m: float, c: float, k: float) -> np.ndarray:
    return np.roots([m, c, k]).astype(complex)


def _compliance(m: float, c: float, k: float, s: complex, extra_s: bool) -> float:
    """|(1/m) / (s^extra (s+b)^2 + omega_d^2)|, the second factor of (31)."""
    b, omega_d2 = c / (2 * m), k / m - (c / (2 * m)) ** 2
    return abs(1 / m / ((s if extra_s else 1) * (s + b) ** 2 + omega_d2))


def _step_response_transform(m: float, c: float, k: float, s: float, prefactor: float) -> float:
    """prefactor (A/s + (B s + C)/((s+b)^2 + omega_d^2)) with A, B, C of (32)."""
    b, omega_d2 = c / (2 * m), k / m - (c / (2 * m)) ** 2
    A = 1 / (b**2 + omega_d2)
    return prefactor * (A / s + (-A * s - 2 * b * A) / ((s + b) ** 2 + omega_d2))


def normal_equation_shapes_agree(printed: bool, rows: int = 42, columns: int = 5) -> bool:
    """Whether (12) can be multiplied at all: (X X^T)^-1 X^T Y as printed, (X^T X)^-1 X^T Y corrected."""
    X, Y = np.ones((rows, columns)), np.ones(rows)
    try:
        _ = (X @ X.T if printed else X.T @ X) @ (X.T @ Y)
    except ValueError:
        return False
    return True


MISPRINTS: tuple[Misprint, ...] = (
    Misprint(
        "(36), (35)",
        "b2 = e^{-bT} (1 - cos wd T + (b/wd) sin wd T) / k",
        "b2 = e^{-bT} (e^{-bT} - cos wd T + (b/wd) sin wd T) / k",
        "b2",
        lambda m, c, k, T: underdamped(m, c, k, T, printed=True)["b2"],
        lambda m, c, k, T: underdamped(m, c, k, T)["b2"],
        lambda m, c, k, T: exact(m, c, k, T)["b2"],
    ),
    Misprint(
        "(31)",
        "(1/m) / (s (s+b)^2 + wd^2)",
        "(1/m) / ((s+b)^2 + wd^2)",
        "|G(s)| at s = i/T",
        lambda m, c, k, T: _compliance(m, c, k, 1j / T, True),
        lambda m, c, k, T: _compliance(m, c, k, 1j / T, False),
        lambda m, c, k, T: abs(1 / (m * (1j / T) ** 2 + c * 1j / T + k)),
    ),
    Misprint(
        "(30)",
        "roots b +- i wd with b = -c/2m, the b of (31)-(36)",
        "roots -b +- i wd with b = +c/2m, which (31)-(36) need",
        "a2 = e^{-2bT}",
        lambda m, c, k, T: float(np.exp(c / m * T)),
        lambda m, c, k, T: float(np.exp(-c / m * T)),
        lambda m, c, k, T: exact(m, c, k, T)["a2"],
    ),
    Misprint(
        "(32)",
        "prefactor A/m",
        "prefactor 1/m (A is inside the braces; (33) and (34) are right)",
        "G(s)/s at s = 1/T",
        lambda m, c, k, T: _step_response_transform(m, c, k, 1 / T, 1 / (m * (k / m))),
        lambda m, c, k, T: _step_response_transform(m, c, k, 1 / T, 1 / m),
        lambda m, c, k, T: T / (m / T**2 + c / T + k),
    ),
    Misprint(
        "(12)",
        "(X X^T)^-1 X^T Y",
        "(X^T X)^-1 X^T Y",
        "1 where the shapes can be multiplied",
        lambda m, c, k, T: float(normal_equation_shapes_agree(printed=True)),
        lambda m, c, k, T: float(normal_equation_shapes_agree(printed=False)),
        lambda m, c, k, T: 1.0,
    ),
    Misprint(
        "below (28)",
        "the roots are imaginary",
        "the roots are complex",
        "real part of a root",
        lambda m, c, k, T: 0.0,
        lambda m, c, k, T: -c / (2 * m),
        lambda m, c, k, T: float(_poles(m, c, k)[0].real),
    ),
    Misprint("above (6)", "a system of n equations", "a system of N equations"),
    Misprint("(3)", "x(i) of samples k", "one index, x(k)"),
    Misprint("above (43)", "re-orientation of Eqn (42)", "re-orientation of Eqn (41)"),
)
