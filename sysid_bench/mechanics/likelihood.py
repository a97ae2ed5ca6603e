"""spectra of one or several records, a start -> maximum likelihood M, D, K with their information matrix.

Gauss-Newton on the output error, the free motion of every record solved for exactly at each point and the
noise weight re-estimated with it. The residual is exact for the hold; the Hessian takes the main image of
the response only, the gradient the neighbouring ones too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, reduce
from operator import add

import numpy as np
from scipy.fft import irfft, rfft

from sysid_bench.mechanics import normal_equations as ne
from sysid_bench.mechanics.hold_spectra import hold_spectrum
from sysid_bench.mechanics.in_band import Spectra, observations
from sysid_bench.mechanics.kronecker import Products, products, with_ends
from sysid_bench.mechanics.noise_weight import estimated, given, modal_gram, root, weigh
from sysid_bench.mechanics.response import (
    Image,
    Maps,
    Modes,
    image,
    modes_of,
    output_modes,
    sampled,
    transfer,
)
from sysid_bench.mechanics.second_order import unpack
from sysid_bench.mechanics.semidefinite import solved
from sysid_bench.nouns import Array, Complex, Diverged

ENDS = (1, 0)  # powers of s in the force that makes the free motion
BLOCK = 32768  # numbers of a transfer function that are formed at a time: they stay in the cache
TOLERANCE = 1e-3  # Newton decrement: half its value is what the log-likelihood can still gain
LIMIT = 120
FAILURES = 9
ROUNDING = 1e-9  # of the output


@dataclass(frozen=True, eq=False)
class Fold:
    """An image of the frequency axis, or several: s (..., F), the held input's spectrum (..., F, nu), the turns (..., F, 3)
    of the gradient there."""

    s: Complex
    held: Complex
    turns: Complex

    def motion(self, modes: Modes, maps: Maps, bins: slice, free: Complex) -> Image:
        return image(modes, maps, self.s[..., bins], self.held[..., bins, :], free)


@dataclass(frozen=True, eq=False)
class Run:
    """One record in the likelihood: its spectra, maps, number of bins, kind of noise or a given weight."""

    data: Spectra
    maps: Maps
    F: int
    noise: str = "diagonal"
    weight: Array | None = None

    @cached_property
    def count(self) -> float:
        share = 1.0 if self.data.mask is None else float(self.data.mask.mean())
        return share * observations(self.data.weight[: self.F])

    @cached_property
    def power(self) -> Array:
        return np.maximum(self.data.power[: self.F].mean(axis=0), 1e-300)

    @cached_property
    def main(self) -> Fold:
        return self._fold(np.zeros(()))

    @cached_property
    def sides(self) -> Fold | None:
        """The neighbouring images (2, F, ...); None where the hold leaves none."""
        return None if self.data.hold == "bandlimited" else self._fold(np.array([[-1.0], [1.0]]))

    def _fold(self, m: Array) -> Fold:
        data, omega = self.data, self.data.omega[: self.F] + 2 * np.pi * m / self.data.h
        held = data.U[: self.F] * hold_spectrum(omega, data.h, data.hold)[..., None]
        return Fold(1j * omega, held, ne.turned(1j * omega))


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
    found, c = sampled(modes, run.maps, data, bins), output_modes(modes, run.maps)
    Y, free = found.forced, found.free
    gram = np.real(np.conj(modes.inverse).T @ modal_gram(free[:F], c, W) @ modes.inverse)
    start = np.zeros(2 * modes.n, dtype=complex)
    for _ in range(1 if data.mask is None else 4):  # with gaps the gram is that of the complete record
        R = _residual(data, Y + (free * start) @ c.T)[:F]
        slope = (modes.inverse.T @ (free[:F] * (np.conj(weigh(W, R)) @ c)).sum(axis=0)).real
        start = start + modes.inverse @ solved(gram, slope, ne.BLIND)
    R = _residual(data, Y + (free * start) @ c.T)[:F]
    if run.weight is not None:
        return Fitted(R, start, free[:F], run.weight, given(R, run.weight))
    return Fitted(R, start, free[:F], *estimated(R, run.power, run.count, run.noise))


def _residual(data: Spectra, Y: Complex) -> Complex:
    if data.mask is None:
        return data.Y[: len(Y)] - Y
    y = irfft(Y / data.weight[:, None], data.N, axis=0)
    return rfft(data.mask[:, None] * (data.y - y), axis=0) * data.weight[:, None]


def information_and_gradient(point: Point, runs: Sequence[Run]) -> tuple[Array, Array]:
    """H (ntheta, ntheta), g of the log-likelihood, the free motions eliminated."""
    parts = [_normal(point, run, fit) for run, fit in zip(runs, point.runs)]
    return sum((H for H, _ in parts), np.zeros(())), sum((g for _, g in parts), np.zeros(()))


@dataclass(frozen=True, eq=False)
class _Sums:
    """Over some bins: products of sensitivities and ends, gradient g (ntheta,)."""

    products: Products
    g: Array

    def __add__(self, other: _Sums) -> _Sums:
        return _Sums(self.products + other.products, self.g + other.g)


def _normal(point: Point, run: Run, fit: Fitted) -> tuple[Array, Array]:
    """H and g of one run; the free motion from the state x is that of the force (s M + D) q + M q' at the start."""
    modes, n = point.modes, run.maps.n
    size = max(BLOCK // n**2, 1)
    sums = (_summed(modes, run, fit, slice(k, min(k + size, run.F))) for k in range(0, run.F, size))
    total = reduce(add, sums)
    M, D, _ = unpack(point.theta, n)
    own = (fit.free * (np.conj(weigh(fit.W, fit.R)) @ output_modes(modes, run.maps))).sum(axis=0)
    slope = np.linalg.solve(np.block([[M, D], [np.zeros((n, n)), M]]), np.real(modes.inverse.T @ own))
    return ne.without_ends(total.products.assembled(ENDS), np.concatenate([total.g, -slope]), len(total.g))


def _summed(modes: Modes, run: Run, fit: Fitted, bins: slice) -> _Sums:
    weight = run.data.weight[bins, None] / run.data.h
    free = weight * fit.start
    main = run.main.motion(modes, run.maps, bins, free)
    W = fit.W[bins] if len(fit.W) == run.F > 1 else fit.W
    seen, R = run.maps.C @ modes.shape, fit.R[bins]
    G, r = _whitened(modes, main, seen, R, W)
    g = ne.gradient(run.main.turns[bins], np.conj((np.conj(r)[:, None, :] @ G)[:, 0]), main.q)
    if run.sides is not None:
        side = run.sides.motion(modes, run.maps, bins, free)
        back = (np.conj(weigh(W, R)) @ seen * side.pole_gain) @ modes.left
        g = g + ne.gradient(run.sides.turns[:, bins], np.conj(back), side.q)
    Omega = with_ends(main.q, main.q, weight[:, 0])
    return _Sums(products(np.conj(G).swapaxes(1, 2) @ G, Omega, main.s.imag), g)


def _whitened(modes: Modes, main: Image, seen: Complex, R: Complex, W: Array) -> tuple[Complex, Complex]:
    """Transfer functions (F, ny, n) and residuals (F, ny) in units of the noise."""
    B = root(W)
    if B.ndim == 3:
        return transfer(modes, B[0] @ seen, main.pole_gain), R @ B[0].T
    if len(B) == 1:
        return transfer(modes, B.T * seen, main.pole_gain), R * B
    return transfer(modes, seen, main.pole_gain) * B[:, :, None], R * B


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
    runs: Sequence[Run],
    phi: Array,
    parameters: Parameters | None = None,
    limit: int = LIMIT,
    tolerance: float = TOLERANCE,
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
        if step is None or step.gain < tolerance:
            converged = step is not None or _decrement(h, s) < 100 * tolerance
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
    return float(g @ solved(H, g, ne.BLIND))


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
