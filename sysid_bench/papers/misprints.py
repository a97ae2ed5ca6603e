"""the papers' equations -> those that are misprinted, each with a number as printed, as meant and as it is."""

from __future__ import annotations

import numpy as np

from sysid_bench.analyses.conversion_error import kappa, kappa_printed
from sysid_bench.mechanics import kapucu_baysec
from sysid_bench.mechanics.integrators import one_step
from sysid_bench.mechanics.second_order import companion
from sysid_bench.nouns import Array
from sysid_bench.papers.bruschetta_2011_theory import K3, start_of_pem, zoh_companion
from sysid_bench.papers.claims import Misprint, Numbers

AT = (2.0, 1.0, 3.0, 1.0)  # m kg, c N s/m, k N/m, T s


def _kapucu_baysec(misprint: kapucu_baysec.Misprint) -> Misprint:
    values = (misprint.printed, misprint.corrected, misprint.exact)

    def numbers() -> Numbers:
        printed, corrected, exact = (value(*AT) for value in values if value is not None)
        return printed, corrected, exact

    return Misprint(
        misprint.equation,
        misprint.printed_text,
        misprint.corrected_text,
        misprint.quantity,
        numbers if misprint.checked else None,
    )


def gain_of_4_14(h: float = 0.05) -> Numbers:
    """Static gain [0][0] of the left-hand side of (4.14), A1 = F22 and A2 = F21 as in (4.12)."""
    F21, F22, B1, B2 = zoh_companion(h)
    eye = np.eye(3)
    gains = [np.linalg.solve(eye + sign * (F22 + F21), B1 + B2)[0, 0] for sign in (1, -1)]
    return float(gains[0]), float(gains[1]), float(np.linalg.inv(K3)[0, 0])


def whiteness_of_4_6(h: float = 0.1) -> Numbers:
    """Lag-1 autocorrelation of e(k) for white output noise, m = k = 1, d = 0.2."""
    named = kapucu_baysec.exact(1, 0.2, 1, h)
    c = np.array([1.0, named["a1"], named["a2"]])
    sums = np.correlate(c, c, "full")
    noise = np.convolve(c, np.random.default_rng(0).standard_normal(200_000), "valid")
    return 0.0, float(sums[3] / sums[2]), float(noise[1:] @ noise[:-1] / (noise @ noise))


def orthogonality_of_3_39() -> Numbers:
    """Inner product of the first and the third column of V0."""
    first = np.ones(3) / np.sqrt(3)
    printed = np.array([-1 / np.sqrt(6), -1 / np.sqrt(6), -np.sqrt(2 / 3)])
    _, _, Vt = np.linalg.svd(_R(1e-4))
    return float(first @ printed), float(first @ (printed * [1, 1, -1])), float(Vt[0] @ Vt[2])


def _R(h: float) -> Array:
    """(3, 3) of (3.34)."""
    return np.array([[h / 4, h / 4, -h / 4], [1 / h, 1 / h, 1 / h], [1, -1, 0]])


def amplification_of_3_31(h: float = 0.1) -> Numbers:
    """(3.31) at the vectors that the text names, with R^-1 as printed and with R."""
    R = _R(h)
    _, _, Vt = np.linalg.svd(R)
    worst, best = Vt[0], Vt[2]
    inverse = np.linalg.inv(R)
    printed = np.linalg.norm(inverse @ best) / np.linalg.norm(inverse @ worst)
    return (
        float(printed),
        float(np.linalg.norm(R @ worst) / np.linalg.norm(R @ best)),
        float(np.linalg.cond(R)),
    )


def sign_of_3_46(h: float = 0.1) -> Numbers:
    """Energy of m = k = 1 moving from q = 0 to q = 0.1 in one step."""

    def Ld(step: float) -> float:
        return step * ((0.1 / step) ** 2 - 0.05**2) / 2

    slope = (Ld(h * (1 + 1e-5)) - Ld(h * (1 - 1e-5))) / (2e-5 * h)
    return slope, -slope, 0.5 * (0.1 / h) ** 2 + 0.5 * 0.05**2


def lmi_of_3_45(h: float = 0.1) -> Numbers:
    """Largest eigenvalue of (3.45) with (3.13), which must not be positive: P and P / h; m = k = 1, d = 0.2."""
    A = companion(np.eye(1), 0.2 * np.eye(1), np.eye(1))
    Ad, Bd = one_step("midpoint", A, np.array([[0.0], [1.0]]), h)
    C = np.array([[0.0, 1.0]])
    Cd, Dd = C @ (np.eye(2) + Ad) / 2, C @ Bd / 2

    def largest(P: Array) -> float:
        cross = Ad.T @ P @ Bd - Cd.T
        return float(
            np.linalg.eigvalsh(np.block([[Ad.T @ P @ Ad - P, cross], [cross.T, Bd.T @ P @ Bd - 2 * Dd]]))[-1]
        )

    return largest(np.eye(2)), largest(np.eye(2) / h), 0.0


KAPUCU_BAYSEC = tuple(_kapucu_baysec(m) for m in kapucu_baysec.MISPRINTS)

BRUSCHETTA = (
    Misprint("(4.15)", "J = M_d^-1 = B1 + B2", "J = M_d^-1 = (B1 + B2) / h", "M[0][0] from an exact ZOH model, h = 0.05 s", start_of_pem),
    Misprint("(4.14)", "[I + A1 z^-1 + A2 z^-2]^-1", "[I - A1 z^-1 - A2 z^-2]^-1, the signs of (4.2) and (4.12)", "static gain [0][0]", gain_of_4_14),
    Misprint("(4.6)", "e(k) white", "e(k) = w(k) - A1 w(k-1) - A2 w(k-2), as below (4.2): coloured", "lag-1 autocorrelation of e (exact: 200 000 samples)", whiteness_of_4_6),
    Misprint("(3.36)", "sigma_max, sigma_min: first and third value of (3.35)", "largest and smallest of all three; sqrt(2) is the largest for 1.24 < h < 3.24", "kappa(2)", lambda: (kappa_printed(2.0), 2.0, kappa(2.0))),
    Misprint("(3.39)", "V0, third column (-1/sqrt 6, -1/sqrt 6, -sqrt(2/3))", "(-1/sqrt 6, -1/sqrt 6, +sqrt(2/3)), as Remark 2 has it", "inner product of columns 1 and 3", orthogonality_of_3_39),
    Misprint("(3.31)", "R^-1 in numerator and denominator", "R dGamma_d over R Gamma_d: the map from discrete to continuous is R", "amplification at the vectors named, h = 0.1", amplification_of_3_31),
    Misprint("(3.46)", "E = dL_d/dh", "E = -dL_d/dh (Marsden and West 2001)", "energy of one step", sign_of_3_46),
    Misprint("Theorem 3.3.1, (3.45)", "same P for the continuous plant and for (3.13)", "P/h: the supply of one step is h y'u", "largest eigenvalue of (3.45), must be <= 0", lmi_of_3_45),
    Misprint("(3.20)", "q = x", "q = [1 0] x"),
    Misprint("(3.15)", "C_c^* x(kh)", "C_c x*(kh)"),
    Misprint("(2.1)", "f(q, q, t)", "f(q, q', t)"),
    Misprint("above (2.19)", "the quadratic Lagrangian (2.5)", "the quadratic Lagrangian (2.3)"),
    Misprint("below (3.33)", "rows of V", "columns of V"),
    Misprint("(A.4), second line", "Z{C (e^At - I) A^-1 B}", "with the factor (1 - z^-1) of (A.1)"),
    Misprint("(A.13)", "D1 L_d^E and f_d^E- at (q0, q1, t0, t1)", "at (q1, q2, t1, t2), as in (2.9)"),
    Misprint("Fig. 5.15", "caption: errors of M", "errors of D, as the text says"),
)  # fmt: skip
