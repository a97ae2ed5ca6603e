"""a point of the likelihood -> information matrix and gradient of M, D, K.

The information takes the main image of the response only, the gradient the neighbouring ones too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np

from sysid_bench.mechanics import normal_equations as ne
from sysid_bench.mechanics.kronecker import Products, grams, products, with_ends
from sysid_bench.mechanics.likelihood import Fitted, Fold, Point, Run
from sysid_bench.mechanics.noise_weight import root, weigh
from sysid_bench.mechanics.response import Image, Modes, output_modes, transfer
from sysid_bench.mechanics.second_order import unpack
from sysid_bench.nouns import Array, Complex

ENDS = (1, 0)  # powers of s in the force that makes the free motion
BLOCK = 32768  # numbers of a transfer function that are formed at a time: they stay in the cache
FEWEST = 512  # bins at a time: with many masses the sums themselves, of n^4 numbers, are what must not be touched often


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
    size = max(BLOCK // n**2, FEWEST)
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
    back = np.conj(weigh(W, R)) @ seen
    g = _pulled(run.main, modes, main, bins, back)
    if run.sides is not None:
        side = run.sides.motion(modes, run.maps, bins, free)
        g = g + _pulled(run.sides, modes, side, bins, back)
    G = _whitened(modes, main, seen, W)
    Omega = with_ends(main.q, main.q, weight[:, 0])
    return _Sums(products(grams(G), Omega, main.s.imag), g)


def _pulled(fold: Fold, modes: Modes, found: Image, bins: slice, back: Complex) -> Array:
    """(ntheta,) the gradient in some images, from the weighed residual's conjugate as the modes see it, back (F, 2n)."""
    return ne.gradient(fold.turns[..., bins, :], np.conj(back * found.pole_gain @ modes.left), found.q)


def _whitened(modes: Modes, main: Image, seen: Complex, W: Array) -> Complex:
    """Transfer functions (F, ny, n) in units of the noise."""
    B = root(W)
    if B.ndim == 3:
        return transfer(modes, B[0] @ seen, main.pole_gain)
    if len(B) == 1:
        return transfer(modes, B.T * seen, main.pole_gain)
    return transfer(modes, seen, main.pole_gain) * B[:, :, None]
