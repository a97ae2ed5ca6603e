"""scalar plant, sampling ratio, perturbation -> errors of m, d, k after conversion back (Bruschetta 3.2, A.4).

The discretised model is perturbed and converted back to continuous time. With the ZOH rule F = exp(A h) and
g are perturbed and converted by the matrix logarithm; with the midpoint rule m_d, d_d, k_d of (2.22) are
perturbed and mapped back by (2.26).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import logm

from sysid_bench.mechanics.conversion import c2d_zoh
from sysid_bench.nouns import Array, InputError, Plant, Sampling


@dataclass(frozen=True)
class ConversionError:
    """Relative rms errors of one conversion; the sampling time follows from the plant's bandwidth.

    Raises InputError on a plant of more than one degree of freedom, an unknown rule, or a sampling ratio
    that is not positive (the i = 0 of section 3.2 would be an infinite sampling time).
    """

    rule: str = "midpoint"
    sampling_ratio: float = 20.0
    perturbation: float = 0.001
    samples: int = 1000

    def __post_init__(self) -> None:
        if self.rule not in ("zoh", "midpoint"):
            raise InputError(f"analysis.rule must be zoh or midpoint; got {self.rule!r}.")
        if not self.sampling_ratio > 0:
            raise InputError(f"analysis.sampling_ratio must be positive; got {self.sampling_ratio!r}.")

    def compute(self, plant: Plant, sampling: Sampling, rng: np.random.Generator) -> dict[str, float]:
        if plant.n != 1:
            raise InputError(f"the conversion study is for one degree of freedom; the plant has {plant.n}.")
        m, d, k = (float(X[0, 0]) for X in (plant.mass, plant.damping, plant.stiffness))
        h = 2 * np.pi / (self.sampling_ratio * bandwidth(m, d, k))
        convert = _perturbed_zoh if self.rule == "zoh" else _perturbed_midpoint
        numbers = convert(np.array([m, d, k]), h, self.perturbation, self.samples, rng)
        return {"h_s": h, "kappa": kappa(h), "kappa_printed": kappa_printed(h), **numbers}


def bandwidth(m: float, d: float, k: float) -> float:
    """3 dB bandwidth in rad/s of 1 / (m s^2 + d s + k), (3.22)."""
    omega_n = np.sqrt(k / m)
    zeta = d / (2 * m * omega_n)
    return omega_n * np.sqrt(1 - 2 * zeta**2 + np.sqrt(4 * zeta**4 - 4 * zeta**2 + 2))


def midpoint_map(h: float) -> Array:
    """(3, 3) matrix from (m, d, k) to (m_d, d_d, k_d), (2.22)."""
    return np.array([[1 / h, 0.5, h / 4], [-2 / h, 0.0, h / 2], [1 / h, -0.5, h / 4]])


def kappa(h: float) -> float:
    """Condition number of the midpoint conversion (2.26), all three singular values taken."""
    return float(np.linalg.cond(midpoint_map(h)))


def kappa_printed(h: float) -> float:
    """(3.36) as printed: the ratio of the first and the third of the values in (3.35)."""
    root = np.sqrt(2304 - 224 * h**4 + 9 * h**8)
    return float(np.sqrt((48 + 3 * h**4 + root) / (48 + 3 * h**4 - root)))


def _perturbed_midpoint(
    mdk: Array, h: float, size: float, samples: int, rng: np.random.Generator
) -> dict[str, float]:
    T = midpoint_map(h)
    discrete = T @ mdk
    errors = size * np.linalg.norm(discrete) * rng.standard_normal((samples, 3))
    found = np.linalg.solve(T, (discrete + errors).T).T  # (samples, 3)
    return _relative(found, mdk) | {"log_failures": 0.0}


def _perturbed_zoh(
    mdk: Array, h: float, size: float, samples: int, rng: np.random.Generator
) -> dict[str, float]:
    m, d, k = mdk
    A, b = np.array([[0.0, 1.0], [-k / m, -d / m]]), np.array([0.0, 1 / m])
    F, G = c2d_zoh(A, b[:, None], h)
    scale = size * np.linalg.norm(F)  # of the entries of F and of g alike, as in step 2 of 3.2.1
    errors = scale * rng.standard_normal((samples, 2, 3))
    As, bs = inverse_zoh(F + errors[:, :, :2], G[:, 0] + errors[:, :, 2], h)
    numbers = {"log_failures": 1 - len(As) / samples, "inverse_log_norm": 1 / float(np.linalg.norm(logm(F)))}
    if not len(As):
        return numbers
    numbers |= _relative(lumped(As, bs), mdk)
    return numbers | {
        "A_error": _rms(As - A) / float(np.linalg.norm(A)),
        "b_error": _rms(bs - b) / float(np.linalg.norm(b)),
        "A_bias": float(np.linalg.norm(As.mean(axis=0) - A) / np.linalg.norm(A)),
    }


def inverse_zoh(F: Array, g: Array, h: float) -> tuple[Array, Array]:
    """A (s, 2, 2), b (s, 2) of perturbed F, g of the same shapes, without those that have no real logarithm."""
    values, V = np.linalg.eig(F.astype(complex))
    real = np.all((np.abs(np.imag(values)) > 1e-12 * np.abs(values)) | (np.real(values) > 0), axis=1)
    logs = V[real] * np.log(values[real])[:, None, :] @ np.linalg.inv(V[real])
    A = np.real(logs) / h
    return A, np.linalg.solve(F[real] - np.eye(2), (A @ g[real][:, :, None]))[:, :, 0]


def lumped(A: Array, b: Array) -> Array:
    """(m, d, k), (s, 3), of two-state models A (s, 2, 2), b (s, 2) whose first state is the displacement.

    The direct projection: [-k/m -d/m] = c A^2 [c; c A]^-1 and 1/m = c A b with c = [1 0].
    """
    slope = A[:, 0]  # c A
    curvature = np.einsum("si,sij->sj", slope, A)  # c A^2
    minus_d_m = curvature[:, 1] / slope[:, 1]
    minus_k_m = curvature[:, 0] - minus_d_m * slope[:, 0]
    m = 1 / np.einsum("si,si->s", slope, b)
    return np.column_stack([m, -m * minus_d_m, -m * minus_k_m])


def _rms(errors: Array) -> float:
    """Frobenius norm of the element-wise root mean square, as in step 3 of 3.2.1."""
    return float(np.linalg.norm(np.sqrt(np.mean(errors**2, axis=0))))


def _relative(found: Array, mdk: Array) -> dict[str, float]:
    rms = np.sqrt(np.mean((found - mdk) ** 2, axis=0))
    return {f"{name}_error": float(r / x) for name, r, x in zip("mdk", rms, mdk)}
