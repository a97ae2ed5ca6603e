"""a drawn machine, input -> what a trial's sensors give: noise, a controller in the loop, sensors that are there, samples lost."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from motion import run, run_in_loop

if TYPE_CHECKING:
    from draw import Draw


def measured(draw: Draw, u, snr: float, free: bool):
    """u, y, y without noise (N, n)."""
    rng, n = draw.rng, draw.n
    x0 = [np.zeros(n)] * 2
    if free:
        x0 = [rng.normal(size=n) * draw.base[k].std(0) for k in range(2)]
    size = 10 ** (-snr / 20)
    if draw.conditions.in_loop:
        noise = rng.normal(size=(len(u), n)) * draw.base[0].std(0) * size
        Q, u = run_in_loop(draw.machine, draw.hidden, u, noise, *_controller(draw), draw.small, x0)
        return u, Q + noise, Q
    Q, _ = run(draw.machine, draw.hidden, u, draw.small, x0)
    return u, Q + _noise(draw, Q) * size, Q


def _noise(draw: Draw, Q: np.ndarray) -> np.ndarray:
    """(N, n) of the size of Q; coloured: first-order, the same variance."""
    white = draw.rng.normal(size=Q.shape)
    rho = draw.conditions.colour
    if rho:
        from scipy.signal import lfilter

        white = lfilter([np.sqrt(1 - rho**2)], [1, -rho], white, axis=0)
    return white * np.nanstd(Q, axis=0)


def _controller(draw: Draw) -> tuple[np.ndarray, np.ndarray]:
    """gain, lead (nu, n): position feedback of a third to the whole of a spring, with some damping."""
    stiff = np.diag(draw.L.T @ draw.K @ draw.L) * np.random.default_rng(draw.N).uniform(0.3, 1)
    return stiff[:, None] * draw.L.T, 0.2 / draw.high * stiff[:, None] * draw.L.T


def sensors(draw: Draw) -> np.ndarray:
    """C (ny, n): each DOF, or some of them (at least one)."""
    if draw.conditions.sensors == 1:
        return np.eye(draw.n)
    count = max(1, round(draw.conditions.sensors * draw.n + draw.own.uniform(-0.5, 0.5)))
    return np.eye(draw.n)[np.sort(draw.own.permutation(draw.n)[:count])]


def flags(draw: Draw, N: int) -> np.ndarray | None:
    """(N,) 1 where a sample was lost, alone or in short bursts."""
    if not draw.conditions.lost:
        return None
    lost = draw.own.random(N) < draw.conditions.lost / 2
    for k in np.flatnonzero(draw.own.random(N) < draw.conditions.lost / 10):
        lost[k : k + 5] = True
    return lost.astype(np.uint8)
