"""Seconds per maximum-likelihood estimate against the number of samples (to 10^6) and of masses (to 32), and their figure.

python benchmarks/cost.py [FIGURE.png]     one core, process time, the median of three up to a second
"""

from __future__ import annotations

import sys

import numpy as np
from estimates import median_ms, record_of

from sysid_bench import conf
from sysid_bench.build import build
from sysid_bench.mechanics.second_order import ntheta, poles
from sysid_bench.methods.spline_ml import SplineML
from sysid_bench.nouns import Model, Plant, Record

SAMPLES = (1000, 3000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
MASSES = (1, 2, 4, 8, 16, 32)
Costs = list[tuple[float, float]]


def chain(n: int) -> Plant:
    """n masses in a row between two walls, damping ratios of 1 to 2 %."""
    K = 100.0 * (2.1 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    return Plant(np.diag(1 + 0.5 * np.sin(np.arange(n))), 0.002 * K + 0.05 * np.eye(n), K)


def fitted(record: Record, n: int, label: str) -> float:
    """Milliseconds of one fit; prints them with the bins of the band and the number of unknowns."""
    said = SplineML().fit(record, Model(n=n)).diagnostics
    taken = median_ms(lambda: SplineML().fit(record, Model(n=n)), 1)
    if taken < 1000:
        taken = median_ms(lambda: SplineML().fit(record, Model(n=n)), 3)
    print(f"{label:28s} {said['bins']:7d} bins {ntheta(n):5d} unknowns {taken:10.1f} ms", flush=True)
    return taken


def against_samples() -> dict[str, Costs]:
    """Three masses: a longer record at h = 0.1 s (a denser band), and a faster one of 600 s (the same band)."""
    three, found = build(conf.option("plant", "three_dof")), {"longer": [], "faster": []}
    for N in SAMPLES:
        ways = {"longer": 0.1, "faster": 600.0 / N}
        for way, h in ways.items():
            record = record_of(three, h, 1.0, 15.0, N)
            found[way].append((N, fitted(record, 3, f"three_dof {way:6s} N = {N}")))
    return found


def against_masses() -> Costs:
    """A chain of n masses, 20 000 samples at h = 0.03 s."""
    return [
        (n, fitted(record_of(chain(n), 0.03, 0.09, 20.0, 20_000), n, f"chain n = {n}"))
        for n in MASSES
        if np.all(poles(chain(n).mass, chain(n).damping, chain(n).stiffness).real < 0)
    ]


def draw(samples: dict[str, Costs], masses: Costs, path: str) -> None:
    """Two panels, both axes logarithmic."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    for way, costs in samples.items():
        left.loglog(*zip(*costs), "o-", label=f"{way} record")
    left.set(xlabel="samples N", ylabel="ms per estimate", title="three masses")
    left.legend()
    right.loglog(*zip(*masses), "o-")
    right.set(xlabel="masses n", title="chain, N = 20 000")
    for axis in (left, right):
        axis.grid(alpha=0.3, which="both")
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    both = against_samples(), against_masses()
    if sys.argv[1:]:
        draw(*both, sys.argv[1])
