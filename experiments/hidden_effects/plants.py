"""a random plant and what drives it."""

from __future__ import annotations

import numpy as np

K8 = [
    [27071.1, 0, 0, 0, -10000, 0, -3535.5, -3535.5], [0, 17071.1, 0, -10000, 0, 0, -3535.5, -3535.5],
    [0, 0, 27071.1, 0, -3535.5, 3535.5, -10000, 0], [0, -10000, 0, 17071.1, 3535.5, -3535.5, 0, 0],
    [-10000, 0, -3535.5, 3535.5, 27071.1, 0, 0, 0], [0, 0, 3535.5, -3535.5, 0, 17071.1, 0, -10000],
    [-3535.5, -3535.5, -10000, 0, 0, 0, 27071.1, 0], [-3535.5, -3535.5, 0, 0, 0, -10000, 0, 17071.1],
]  # fmt: skip


def plant(kind: str, rng) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """M, D, K (n, n) and the sampling time in s of `one`, `three` or `eight` masses."""
    if kind == "one":
        return np.eye(1), np.array([[rng.choice([0.15, 0.3, 1.0])]]), np.eye(1), 0.05
    if kind == "three":
        K = np.array([[4.0, -1, -1], [-1, 4, -1], [-1, -1, 4]])
        return np.diag([0.8, 2, 1.2]), 0.1 * K, K, 0.05
    K = np.array(K8)
    return 100 * np.eye(8), 0.005 * K + np.eye(8), K, 0.01


def excite(kind: str, N: int, h: float, nu: int, low: float, high: float, rng) -> np.ndarray:
    """(N, nu) of unit variance over the plant's band low..high rad/s."""
    return np.column_stack([_signal(kind, N, h, low, high, c, rng) for c in range(nu)])


def _signal(kind: str, N: int, h: float, low: float, high: float, c: int, rng) -> np.ndarray:
    t = np.arange(N) * h
    if kind == "noise":
        w = 2 * np.pi * np.fft.rfftfreq(N, h)
        X = (rng.normal(size=len(w)) + 1j * rng.normal(size=len(w))) / (1 + (w / (1.2 * high)) ** 8)
        X[0] = 0
        u = np.fft.irfft(X, N)
    elif kind == "prbs":
        width = max(1, round(np.pi / high / 1.5 / h))
        u = np.repeat(rng.choice([-1.0, 1.0], N // width + 1), width)[:N]
    elif kind == "multisine":
        base = 2 * np.pi / (N * h / 4)
        w = base * np.unique(np.round(np.linspace(0.3 * low, 1.6 * high, 60) / base))
        u = sum(np.sin(x * t + p) for x, p in zip(w, rng.uniform(0, 2 * np.pi, len(w))))
    else:
        T = N * h / rng.integers(2, 5)
        s = t % T
        f0, f1 = (0.2 * low, 1.6 * high) if c % 2 == 0 else (1.6 * high, 0.2 * low)
        u = np.sin(f0 * s + (f1 - f0) * s**2 / 2 / T)
    return u / u.std()
