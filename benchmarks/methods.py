"""Seconds per estimate of every method on every size of plant, as ratios to n4sid without standard errors; medians.

python benchmarks/methods.py [method ...]
"""

from __future__ import annotations

import statistics
import sys
import time

import numpy as np

from sysid_bench import conf
from sysid_bench.build import build
from sysid_bench.excitations.cubic_noise import CubicNoise
from sysid_bench.methods.n4sid import N4sid
from sysid_bench.noises.white import White
from sysid_bench.nouns import Diverged, Method, Model, NotApplicable, Plant, Record, Sampling
from sysid_bench.sources.simulation import Simulation

REPEATS, ENOUGH_S = 5, 3.0
CASES = (
    ("one_dof", Sampling(h_s=0.1, N=6000), 1.0, 15.0),
    ("three_dof", Sampling(h_s=0.1, N=6000), 1.0, 15.0),
    ("eight_dof", Sampling(h_s=0.0125, N=6000), 0.1, 20.0),
)


def seconds(method: Method, record: Record, model: Model) -> tuple[float, str]:
    """Median wall seconds of one fit, and its status."""
    taken, status = [], "ok"
    while len(taken) < REPEATS and sum(taken) < ENOUGH_S:
        begin = time.perf_counter()
        try:
            method.fit(record, model)
        except (NotApplicable, Diverged) as problem:
            status = f"{type(problem).__name__}: {problem}"
        taken.append(time.perf_counter() - begin)
    return statistics.median(taken), status


def main(names: list[str]) -> int:
    """One line per plant and method."""
    methods = {name: build(conf.option("method", name)) for name in names or conf.groups()["method"]}
    for plant_name, sampling, knots_s, snr_db in CASES:
        plant: Plant = build(conf.option("plant", plant_name))
        parts = CubicNoise(knot_spacing_s=knots_s), White(snr_db=snr_db), sampling
        record = Simulation().acquire(plant, *parts, np.random.default_rng(0)).record
        full, bare = plant.model(), plant.model().structure_only()
        unit, _ = seconds(N4sid(blocks=0), record, bare)
        print(f"{plant_name}, N = {sampling.N}, h = {sampling.h_s} s: n4sid {1e3 * unit:.1f} ms")
        for name, method in methods.items():
            taken, status = seconds(method, record, full if method.nominal else bare)
            print(f"  {name:26s} x{taken / unit:7.1f}  {1e3 * taken:8.1f} ms  {status}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
