"""Seconds per maximum-likelihood estimate: against h; against finite differences and a CasADi Jacobian.

python benchmarks/estimates.py [h | rivals ...]     nothing: all. One core, medians of process time.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from itertools import product

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from sysid_bench import conf
from sysid_bench.build import build
from sysid_bench.mechanics.estimation import in_band_run, problem_of
from sysid_bench.mechanics.levenberg import Point, minimise
from sysid_bench.mechanics.second_order import ntheta, unpack
from sysid_bench.mechanics.simulate import simulate
from sysid_bench.mechanics.start import linear_start
from sysid_bench.methods.spline_ml import SplineML
from sysid_bench.nouns import Array, Model, Plant, Record

STEPS = {
    "three_dof": (1.0, (15.0,), (1.0, 0.5, 0.25, 0.1, 0.04, 0.01, 0.005)),
    "eight_dof": (0.1, (20.0, 8.0), (0.1, 0.05, 0.025, 0.0125, 0.005, 0.0025, 0.001)),
}


def record_of(plant: Plant, h: float, knot_s: float, snr_db: float, N: int = 6000, seed: int = 0) -> Record:
    """Cubic noise force, white noise."""
    rng = np.random.default_rng(seed)
    t = h * np.arange(N)
    count = int(t[-1] / knot_s) + 4
    u = CubicSpline(knot_s * np.arange(count), rng.standard_normal((count, plant.nu)))(t)
    y = simulate(plant, u, h, "cubic")
    return Record(t, u, y + rng.standard_normal(y.shape) * y.std(axis=0) * 10 ** (-snr_db / 20), "cubic")


def median_ms(work: Callable[[], object], repeats: int) -> float:
    """Median process time in ms, after one call to warm up where it is repeated."""
    taken = []
    for _ in range(repeats + (repeats > 1)):
        begin = time.process_time()
        work()
        taken.append(time.process_time() - begin)
    return 1e3 * statistics.median(taken[repeats > 1 :])


def against_h() -> None:
    """N = 6000: what an estimate costs at every sampling time and signal to noise ratio."""
    for name, (knot_s, ratios, steps) in STEPS.items():
        plant = build(conf.option("plant", name))
        for h, snr_db in product(steps, ratios):
            records = [record_of(plant, h, knot_s, snr_db, seed=k) for k in range(5)]
            each = [median_ms(lambda r=r, n=plant.n: SplineML().fit(r, Model(n=n)), 3) for r in records]
            print(
                f"{name:10s} {snr_db:4g} dB  h = {h:<7g} {statistics.median(each):8.1f} ms"
                f"  ({min(each):.1f} to {max(each):.1f})",
                flush=True,
            )


def finite_differences(plant: Plant, record: Record, start: Array) -> Callable[[], object]:
    """The same likelihood by time simulation, its Jacobian by forward differences."""
    n, count = plant.n, ntheta(plant.n)

    def output(p: Array) -> Array:
        return simulate(Model(*unpack(p[:count], n)), record.u, record.h, "cubic", p[count:])

    def jacobian(p: Array, y: Array) -> Array:
        sizes = 1e-6 * np.maximum(np.abs(p), 1e-3)
        steps = np.eye(len(p)) * sizes
        return np.stack([(output(p + step) - y) / size for step, size in zip(steps, sizes)], axis=2)

    return lambda: minimise(
        _point(record, output, jacobian), np.concatenate([start, np.zeros(2 * n)]), 40, 1e-3
    )


def casadi_jacobian(plant: Plant, record: Record, start: Array) -> Callable[[], object]:
    """Output error of the midpoint rule, its Jacobian by CasADi through a mapped accumulation (built outside)."""
    n, count, h = plant.n, ntheta(plant.n), record.h
    theta, x, u = ca.SX.sym("p", count), ca.SX.sym("x", 2 * n), ca.SX.sym("u", n)
    matrices = []
    for block in range(3):
        X = ca.SX(n, n)
        for k, (i, j) in enumerate(zip(*np.triu_indices(n))):
            X[i, j] = X[j, i] = theta[block * count // 3 + k]
        matrices.append(X)
    M, D, K = matrices
    A = ca.vertcat(ca.horzcat(ca.SX(n, n), ca.SX.eye(n)), -ca.solve(M, ca.horzcat(K, D)))
    right = ca.mtimes(ca.SX.eye(2 * n) + h / 2 * A, x) + h * ca.vertcat(ca.SX(n, 1), ca.solve(M, u))
    step = ca.Function("step", [x, u, theta], [ca.solve(ca.SX.eye(2 * n) - h / 2 * A, right)])
    p = ca.MX.sym("p", count + 2 * n)
    force = (record.u[:-1] + record.u[1:]).T / 2
    path = step.mapaccum(record.N - 1)(p[count:], force, ca.repmat(p[:count], 1, record.N - 1))
    outputs = ca.horzcat(p[count : count + n], path[:n, :])
    found = ca.Function("found", [p], [outputs])
    slope = ca.Function("slope", [p], [ca.jacobian(ca.vec(outputs), p)])

    def output(values: Array) -> Array:
        return np.array(found(values)).T

    def jacobian(values: Array, _y: Array) -> Array:
        return np.array(slope(values)).reshape(record.N, n, -1)

    return lambda: minimise(
        _point(record, output, jacobian), np.concatenate([start, np.zeros(2 * n)]), 40, 1e-3
    )


def _point(record: Record, output: Callable, jacobian: Callable) -> Callable[[Array], Point]:
    def evaluate(p: Array) -> Point:
        y = output(p)
        residual = record.y - y
        variance = np.mean(residual**2, axis=0)
        J = jacobian(p, y)
        hessian = np.einsum("kyp,y,kyq->pq", J, 1 / variance, J, optimize=True)
        return Point(p, variance, hessian, np.einsum("kyp,y,ky->p", J, 1 / variance, residual, optimize=True))

    return evaluate


def rivals() -> None:
    """The same records, the same start, the whole estimate; ratios to ours."""
    for name, h in (("three_dof", 0.1), ("three_dof", 0.04), ("eight_dof", 0.0125)):
        knot_s, (snr_db, *_), _ = STEPS[name]
        plant = build(conf.option("plant", name))
        record = record_of(plant, h, knot_s, snr_db)
        problem = problem_of([record], Model(n=plant.n), "diagonal", False, False)
        start = linear_start([in_band_run(record, problem, "cubic")], problem.free, problem.known)
        ours = median_ms(lambda record=record, n=plant.n: SplineML().fit(record, Model(n=n)), 5)
        print(f"{name} h = {h:g}: in band {ours:.1f} ms", flush=True)
        makers = {"finite differences": finite_differences, "CasADi Jacobian": casadi_jacobian}
        for what, make in makers.items():
            if what == "CasADi Jacobian" and plant.n > 3:
                continue  # its Jacobian takes more memory than time
            taken = median_ms(make(plant, record, start), 1)
            print(f"    {what}: {taken:.0f} ms, {taken / ours:.0f} times as long", flush=True)


if __name__ == "__main__":
    wanted = sys.argv[1:] or ["h", "rivals"]
    for part in wanted:
        {"h": against_h, "rivals": rivals}[part]()
