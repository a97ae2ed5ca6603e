"""true structure, fitted by the workflow's own descent -> how often the 95 % intervals of its parameters hold the truth.

    python experiments/hidden_effects/coverage.py --names input_delay,sensor_bias --size one --first 3000 --count 40

No name is chosen here, so what is counted is the fit and its covariance alone; seeds below 5000 are for tuning.
"""

# ruff: noqa: E402
from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # before numpy is loaded
    os.environ.setdefault(_name, "1")

import argparse
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from attempt import CERTAIN, model_of, records_of, true_effect
from draw import Draw
from judge import NOT_COMPARED, off
from tally import markdown, share

from sysid_bench.gap.check_data import check_data
from sysid_bench.gap.descent import Fit, fit, free_parameters
from sysid_bench.gap.fineness import on_finer_steps
from sysid_bench.gap.prepare import prepared
from sysid_bench.gap.problem import Problem
from sysid_bench.gap.rounding import for_any_rounding

TUNING = 5000


def errors(name: str, size: str, seed: int) -> Iterator[tuple[str, float]]:
    """(parameter, error over its standard error) of one trial; none where the draw is no fair case."""
    trial = Draw(seed, kind="single", name=name, size=size).trial()
    true = trial.truth["effects"][0]
    effect = true_effect(true)
    if trial.truth["bad"] or true["name"] != name or effect is None:
        return
    train, _ = records_of(trial)
    problem, _, _ = prepared(train, model_of(trial), check_data(train))
    found = fit(problem, replace(problem.nominal(), effects=(effect,)), free_parameters((effect,)))
    if found is None:
        return
    found = for_any_rounding(*on_finer_steps(problem, found))
    if found.covariance is None:
        return
    for key, value, std in fitted(problem, found):
        if key in true["values"] and key not in NOT_COMPARED and std > 0:
            yield key, off(key, value - true["values"][key]) / std


def fitted(problem: Problem, found: Fit) -> Iterator[tuple[str, float, float]]:
    """(parameter, value, standard error) of the last effect."""
    effect, covariance = found.point.effects[-1], found.covariance
    assert covariance is not None
    for k, (_, p) in enumerate(found.parameters):
        at = len(problem.entries) + k
        size = abs(effect.values[p]) if problem.by_log(effect, p) else 1.0
        yield effect.numeric[p], float(effect.values[p]), float(np.sqrt(covariance[at, at]) * size)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--names", required=True, help="effects, separated by commas")
    parser.add_argument("--size", choices=("one", "three", "eight"), default="one")
    parser.add_argument("--first", type=int, default=3000)
    parser.add_argument("--count", type=int, default=40)
    given = parser.parse_args()
    if given.first + given.count > TUNING:
        parser.error(f"seeds from {TUNING} on are kept for what is reported of the whole workflow")
    body = []
    for name in given.names.split(","):
        seen: dict[str, list[float]] = {}
        for seed in range(given.first, given.first + given.count):
            for key, z in errors(name, given.size, seed):
                seen.setdefault(key, []).append(z)
        for key, z in seen.items():
            rms = f"{np.sqrt(np.mean(np.square(z))):.2f}"
            body.append(
                [f"{name}.{key}", str(len(z)), share([{"hit": abs(x) <= CERTAIN} for x in z], "hit"), rms]
            )
            print(*body[-1], flush=True)
    print(markdown(("parameter", "intervals", "hold the truth, %", "rms error over standard error"), body))


if __name__ == "__main__":
    main()
