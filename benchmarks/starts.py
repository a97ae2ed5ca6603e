"""How near the structured linear start comes to the Cramer-Rao bound, before any search: against h.

python benchmarks/starts.py     S = rms over ten records of error / bound, for M / D / K. One core, a minute.
"""

from __future__ import annotations

import numpy as np
from estimates import STEPS, record_of

from sysid_bench import conf
from sysid_bench.build import build
from sysid_bench.mechanics.estimation import fit_problem, in_band_run, problem_of
from sysid_bench.mechanics.fisher import crlb
from sysid_bench.mechanics.second_order import unpack
from sysid_bench.mechanics.start import linear_start, refined_start
from sysid_bench.nouns import Array, Model, Plant, Record

RECORDS = 10
EVERY = 2  # of the steps in h


def thetas(record: Record, n: int) -> tuple[list[Array], int]:
    """theta (ntheta,) of least squares, of the instruments after it, of the maximum; iterations of the search on all bins."""
    problem = problem_of([record], Model(n=n), "diagonal", False, False)
    runs = [in_band_run(record, problem, "cubic")]
    first = linear_start(runs, problem.free, problem.known)
    refined = refined_start(runs, problem.free, first).theta
    found = fit_problem(problem, "cubic").maximum
    return [first, refined, found.theta], found.iterations


def over_bound(plant: Plant, record: Record, snr_db: float, theta: Array) -> Array:
    """(3,) relative errors of M, D, K over their bounds."""
    variance = record.y.var(axis=0) / (1 + 10 ** (snr_db / 10))
    bound = crlb(plant, record, variance)
    errors = [
        np.linalg.norm(X - truth) / np.linalg.norm(truth)
        for X, truth in zip(unpack(theta, plant.n), plant.matrices)
    ]
    return np.array(errors) / (bound.M, bound.D, bound.K)


def main() -> None:
    for name, (knot_s, ratios, steps) in STEPS.items():
        plant = build(conf.option("plant", name))
        for h, snr_db in ((h, snr_db) for snr_db in ratios for h in steps[::EVERY]):
            records = [record_of(plant, h, knot_s, snr_db, seed=k) for k in range(RECORDS)]
            found = [thetas(record, plant.n) for record in records]
            ratios_of = [
                [over_bound(plant, record, snr_db, theta) for theta in one]
                for record, (one, _) in zip(records, found)
            ]
            S = np.sqrt((np.array(ratios_of) ** 2).mean(axis=0))
            words = ["/".join(f"{x:.3g}" for x in row) for row in S]
            print(
                f"{name:10s} {snr_db:4g} dB  h = {h:<7g} least squares {words[0]:18s} instruments {words[1]:18s}"
                f" maximum {words[2]:15s} after {np.median([count for _, count in found]):g} iterations",
                flush=True,
            )


if __name__ == "__main__":
    with np.errstate(all="ignore"):
        main()
