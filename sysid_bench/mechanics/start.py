"""runs of the likelihood -> where to start it, best first: linear least squares and refined instruments, modes.

An instrumental step is taken while the likelihood gains from it: near the optimum each is worth several
Gauss-Newton steps, at a poor signal to noise ratio they run away.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sysid_bench.mechanics.definite_parameters import definite_parameters, factor
from sysid_bench.mechanics.likelihood import Point, Run, evaluate, unexplained
from sysid_bench.mechanics.linear_start import equation_error_normal
from sysid_bench.mechanics.maximum import maximise
from sysid_bench.mechanics.modal_start import modal_start
from sysid_bench.mechanics.refined_iv import definite, refine
from sysid_bench.mechanics.second_order import pack, unpack
from sysid_bench.mechanics.semidefinite import solved
from sysid_bench.nouns import Array, Diverged, NotApplicable

BLIND = 1e-14  # a direction with less information, relative to the largest, stays at zero
STEPS = 3
LIFTS = (0.1, 0.2, 0.3, 0.05)  # of the largest eigenvalue: where a search among positive matrices starts
SAMPLES_PER_PERIOD = (8.0, 5.0, 12.0, 4.0, 3.5)  # of the top mode, for the subspace step; each another chance
GROWTH = 0.01  # of a mode, relative to its frequency: an instrumental step that ends there has run away
SETTLED = 30.0  # gain of log-likelihood below which Gauss-Newton is the better next step
FLOOR = 2.0  # times the noise above the band that is left in it: below, it is as well


def starts(
    runs: list[Run], free: NDArray[np.bool_], known: Array, guess: Array | None, whole_band: bool
) -> Iterator[Callable[[], Point]]:
    """Functions that return the likelihood at a start, or raise Diverged or NotApplicable."""
    yield lambda: refined_start(runs, free, linear_start(runs, free, known))
    yield lambda: evaluate(linear_start(runs, free, known), runs)
    if whole_band:
        for lift in LIFTS:
            yield partial(definite_start, runs, free, known, lift)
        for per_period in SAMPLES_PER_PERIOD:
            yield partial(_from_modes, runs, free, known, per_period)
        if guess is not None:
            yield lambda: evaluate(np.array(guess), runs)


def _from_modes(runs: list[Run], free: NDArray[np.bool_], known: Array, per_period: float) -> Point:
    run = runs[0]
    return evaluate(np.where(free, modal_start(run.data, run.maps, run.F, per_period), known), runs)


def linear_start(runs: list[Run], free: NDArray[np.bool_], known: Array) -> Array:
    """theta (ntheta,) by equation-error least squares over all runs, entries that are not free kept at `known`.

    Raises NotApplicable where not every degree of freedom has its own sensor.
    """
    for run in runs:
        if run.maps.C.shape[0] < run.maps.n or np.linalg.matrix_rank(run.maps.C) < run.maps.n:
            raise NotApplicable("the linear start needs a sensor on every degree of freedom.")
    parts = [equation_error_normal(run.equation) for run in runs]
    H, g = sum((H for H, _ in parts), np.zeros(())), sum((g for _, g in parts), np.zeros(()))
    theta = np.array(known, dtype=float)
    right = g[free] - H[np.ix_(free, ~free)] @ theta[~free]
    theta[free] = solved(H[np.ix_(free, free)], right, BLIND)
    return theta


def refined_start(runs: list[Run], free: NDArray[np.bool_], theta: Array) -> Point:
    """The likelihood after instrumental-variable steps from theta (ntheta,), as long as it gains from them and no mode
    grows; all entries free only."""
    point = evaluate(theta, runs)
    if len(runs) > 1 or not free.all():
        return point
    for _ in range(STEPS):
        trial = _refined(runs, point.theta)
        if trial is None or trial.cost >= point.cost:
            return point
        gain, point = point.cost - trial.cost, trial
        if gain < SETTLED or 0 < unexplained(point, runs) < FLOOR:
            return point
    return point


def definite_start(runs: list[Run], free: NDArray[np.bool_], known: Array, lift: float) -> Point:
    """The likelihood after a search among positive matrices, from linear_start lifted well into them; all free only.

    Noise on the output makes the least-squares matrices too small and indefinite; outside the positive ones lie most
    of the wrong maxima. Raises NotApplicable with other entries.
    """
    if not free.all():
        raise NotApplicable("a search among positive matrices wants all entries free.")
    n = runs[0].maps.n
    lifted = pack(*definite(np.stack(unpack(linear_start(runs, free, known), n)), lift))
    return evaluate(maximise(runs, factor(lifted, n), definite_parameters(n)).theta, runs)


def _refined(runs: list[Run], theta: Array) -> Point | None:
    """The likelihood after one instrumental step; None where it cannot be simulated or a mode grows."""
    try:
        point = evaluate(refine(runs[0].equation, theta, steps=1)[0], runs)
    except Diverged:
        return None
    poles = point.modes.poles
    return point if np.all(poles.real <= GROWTH * np.abs(poles)) else None
