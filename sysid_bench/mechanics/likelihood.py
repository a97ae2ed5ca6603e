"""spectra of one or several records, a start -> maximum likelihood M, D, K with their information matrix.

Gauss-Newton on the output error, the free motion of every record solved for exactly at each point and the
noise weight re-estimated with it. The residual is exact for the hold; the Hessian takes the main image of
the response only, the gradient the neighbouring ones too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import reduce
from operator import add

import numpy as np
from scipy.fft import irfft, rfft

from sysid_bench.mechanics import normal_equations as ne
from sysid_bench.mechanics.in_band import Spectra, observations, some_bins
from sysid_bench.mechanics.noise_weight import estimated, given, modal_gram, weigh
from sysid_bench.mechanics.response import (
    Maps,
    Modes,
    forced,
    image,
    modes_of,
    output_modes,
    transfer,
    transient,
)
from sysid_bench.mechanics.second_order import unpack
from sysid_bench.nouns import Array, Complex, Diverged

IMAGES = (0, -1, 1)
BLOCK = 512  # bins whose sensitivities are formed at a time: they stay in the cache
TOLERANCE = 1e-3  # Newton decrement: half its value is what the log-likelihood can still gain
LIMIT = 120
FAILURES = 9
ROUNDING = 1e-9  # of the output


@dataclass(frozen=True, eq=False)
class Run:
    """One record in the likelihood: its spectra, maps, number of bins, kind of noise or a given weight."""

    data: Spectra
    maps: Maps
    F: int
    noise: str = "diagonal"
    weight: Array | None = None

    @property
    def count(self) -> float:
        share = 1.0 if self.data.mask is None else float(self.data.mask.mean())
        return share * observations(self.data.weight[: self.F])

    @property
    def power(self) -> Array:
        return np.maximum((np.abs(self.data.Y[: self.F]) ** 2).mean(axis=0), 1e-300)


@dataclass(frozen=True, eq=False)
class Fitted:
    """A run at a point: residual (F, ny), modal start (2n,), its spectra (F, 2n), noise weight, cost."""

    R: Complex
    start: Complex
    free: Complex
    W: Array
    cost: float


@dataclass(frozen=True, eq=False)
class Point:
    """The likelihood at theta (ntheta,): the modes there, each run's fit, the cost."""

    theta: Array
    modes: Modes
    runs: tuple[Fitted, ...]
    cost: float


@dataclass(frozen=True, eq=False)
class Parameters:
    """theta as a function of what is free: value(phi), slope(phi) (ntheta, nphi). Identity by default."""

    value: Callable[[Array], Array] = field(default=lambda phi: phi)
    slope: Callable[[Array], Array] | None = None


def evaluate(theta: Array, runs: Sequence[Run], before: Sequence[Fitted] | None = None) -> Point:
    """The likelihood at theta. Raises Diverged where the matrices cannot be simulated."""
    modes = modes_of(*unpack(theta, runs[0].maps.n))
    fitted = tuple(_fit_run(modes, run, None if before is None else before[k]) for k, run in enumerate(runs))
    cost = sum(f.cost for f in fitted)
    if not np.isfinite(cost):
        raise Diverged("the likelihood is not finite.")
    return Point(theta, modes, fitted, cost)


def _fit_run(modes: Modes, run: Run, before: Fitted | None) -> Fitted:
    data, F = run.data, run.F
    bins = F if data.mask is None else len(data.omega)
    W = run.weight if run.weight is not None else before.W if before is not None else None
    if W is None:
        W = 1 / run.power[None]
    Y, free, c = (
        forced(modes, run.maps, data, bins),
        transient(modes, data, bins),
        output_modes(modes, run.maps),
    )
    gram = np.real(np.conj(modes.inverse).T @ modal_gram(free[:F], c, W) @ modes.inverse)
    start = np.zeros(2 * modes.n, dtype=complex)
    for _ in range(1 if data.mask is None else 4):  # with gaps the gram is that of the complete record
        R = _residual(data, Y + (free * start) @ c.T)[:F]
        slope = (modes.inverse.T @ (free[:F] * (np.conj(weigh(W, R)) @ c)).sum(axis=0)).real
        start = start + modes.inverse @ _solve_scaled(gram, slope)
    R = _residual(data, Y + (free * start) @ c.T)[:F]
    if run.weight is not None:
        return Fitted(R, start, free[:F], run.weight, given(R, run.weight))
    return Fitted(R, start, free[:F], *estimated(R, run.power, run.count, run.noise))


def _residual(data: Spectra, Y: Complex) -> Complex:
    if data.mask is None:
        return data.Y[: len(Y)] - Y
    y = irfft(Y / data.weight[:, None], data.N, axis=0)
    return rfft(data.mask[:, None] * (data.y - y), axis=0) * data.weight[:, None]


def _solve_scaled(H: Array, g: Array) -> Array:
    d = np.sqrt(np.maximum(np.diag(H), 1e-300))
    return np.linalg.lstsq(H / np.outer(d, d), g / d, rcond=1e-13)[0] / d


def information_and_gradient(point: Point, runs: Sequence[Run]) -> tuple[Array, Array]:
    """H (ntheta, ntheta), g of the log-likelihood, the free motions eliminated."""
    parts = [_normal(point.modes, run, fit) for run, fit in zip(runs, point.runs)]
    return sum((H for H, _ in parts), np.zeros(())), sum((g for _, g in parts), np.zeros(()))


@dataclass(frozen=True, eq=False)
class _Sums:
    """Over some bins: information H (ntheta, ntheta), gradient g (ntheta,), and what the free motion takes of them:
    X (ntheta, 2n) across, A (2n, 2n) its own, slope (2n,)."""

    H: Array
    g: Array
    X: Array
    A: Array
    slope: Array

    def __add__(self, other: _Sums) -> _Sums:
        return _Sums(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    def without_free_motion(self) -> tuple[Array, Array]:
        """H and g with the free motion eliminated, its main image too: what cannot be told stays exactly blind."""
        d = np.sqrt(np.maximum(np.diag(self.A), 1e-300))
        scaled, right = self.A / np.outer(d, d), np.column_stack([self.X.T, self.slope]) / d[:, None]
        half = np.linalg.lstsq(scaled, right, rcond=1e-13)[0]
        return self.H - (self.X / d) @ half[:, :-1], self.g - (self.X / d) @ half[:, -1]


def _normal(modes: Modes, run: Run, fit: Fitted) -> tuple[Array, Array]:
    sums = (_summed(modes, run, fit, slice(k, k + BLOCK)) for k in range(0, run.F, BLOCK))
    return reduce(add, sums).without_free_motion()


def _summed(modes: Modes, run: Run, fit: Fitted, bins: slice) -> _Sums:
    data, R, maps = some_bins(run.data, slice(bins.start, min(bins.stop, run.F))), fit.R[bins], run.maps
    W = fit.W[bins] if len(fit.W) == run.F > 1 else fit.W
    main, *folds = (image(modes, maps, data, len(R), m, fit.start) for m in _images(data))
    G, c, seen = transfer(modes, maps, main), output_modes(modes, maps), maps.C @ modes.shape
    GW = np.conj(np.swapaxes(weigh(W, G), 1, 2))  # G^H W: W is real and symmetric
    Omega = np.conj(main.q)[:, :, None] * main.q[:, None, :]
    WR = weigh(W, R)
    g = ne.gradient(main.s, (GW @ R[:, :, None])[:, :, 0], main.q)
    for fold in folds:
        back = ((WR @ np.conj(seen)) * np.conj(fold.pole_gain)) @ np.conj(modes.left)
        g = g + ne.gradient(fold.s, back, fold.q)
    free = main.pole_gain * (data.weight[:, None] / data.h)
    X = ne.cross(main.s, main.q, (GW @ seen) * free[:, None, :]) @ modes.inverse
    A = np.conj(modes.inverse).T @ modal_gram(free, seen, W) @ modes.inverse
    slope = modes.inverse.T @ (fit.free[bins] * (np.conj(WR) @ c)).sum(axis=0)
    H = ne.information(GW @ G, Omega, main.s.imag)
    return _Sums(H, g, np.real(X), np.real(A), np.real(slope))


def _images(data: Spectra) -> tuple[int, ...]:
    return IMAGES[:1] if data.hold == "bandlimited" else IMAGES


@dataclass(frozen=True, eq=False)
class Maximum:
    """Where the search ended: theta, information H of theta (one last, small step before), cost, iterations."""

    theta: Array
    H: Array
    cost: float
    iterations: int
    converged: bool
    point: Point


def maximise(
    runs: Sequence[Run], phi: Array, parameters: Parameters | None = None, limit: int = LIMIT
) -> Maximum:
    """Levenberg-Marquardt from phi. Raises Diverged where not even the start can be simulated."""
    parameters = parameters or Parameters()
    point = evaluate(parameters.value(phi), runs)
    mu, converged, iterations = 0.0, False, 0
    while iterations < limit:
        iterations += 1
        H, g = information_and_gradient(point, runs)
        h, s = (H, g) if parameters.slope is None else _pulled(H, g, parameters.slope(phi))
        step = _step(h, s, phi, mu, point, runs, parameters)
        if step is None or step.gain < TOLERANCE:
            converged = step is not None or _decrement(h, s) < 100 * TOLERANCE
            phi, point = (phi, point) if step is None else (step.phi, step.point)
            break
        phi, point, mu = step.phi, step.point, step.mu
    return Maximum(point.theta, H, point.cost, iterations, converged or _at_rounding(point, runs), point)


def _at_rounding(point: Point, runs: Sequence[Run]) -> bool:
    """True where the residual is nothing but arithmetic: the record has no noise."""
    return all(
        np.linalg.norm(fit.R) < ROUNDING * np.linalg.norm(run.data.Y[: run.F])
        for fit, run in zip(point.runs, runs)
    )


@dataclass(frozen=True, eq=False)
class _Step:
    phi: Array
    point: Point
    mu: float
    gain: float


def _pulled(H: Array, g: Array, T: Array) -> tuple[Array, Array]:
    return T.T @ H @ T, T.T @ g


def _decrement(H: Array, g: Array) -> float:
    return float(g @ _solve_scaled(H, g))


def _step(H, g, phi, mu, point, runs, parameters) -> _Step | None:
    """The first damped step that does not lose likelihood; None where none is found."""
    d = np.sqrt(np.maximum(np.diag(H), 1e-300))
    Hs, gs = H / np.outer(d, d), g / d
    for _ in range(FAILURES):
        try:
            move = np.linalg.solve(Hs + mu * np.eye(len(d)), gs)
            trial = evaluate(parameters.value(phi + move / d), runs, point.runs)
        except (Diverged, np.linalg.LinAlgError):
            trial = None
        if trial is not None and trial.cost <= point.cost + 1e-10 * abs(point.cost):
            return _Step(phi + move / d, trial, 0.0 if mu < 1e-5 else mu / 10, float(move @ gs))
        mu = max(10 * mu, 1e-3)
    return None
