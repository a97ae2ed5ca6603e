"""How long the gap workflow takes on two records of 10 000 samples: median and worst per size, of each kind of case and of
all together; the screening of all suspects, start-up, and the first compilation on a machine, which is kept (numba's cache beside
the source, else in the user's cache folder). Processor seconds of one core: waiting does not count, but a
busy neighbour on the same core slows each of them.

python benchmarks/gap.py [cases per size and kind]     6 by default; 0: start-up and screening alone
"""

# ruff: noqa: E402
from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # before numpy is loaded
    os.environ.setdefault(_name, "1")

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "experiments" / "hidden_effects"))

from draw import Draw

from sysid_bench.effects import effect_class, names
from sysid_bench.gap.check_data import check_data
from sysid_bench.gap.prepare import prepared
from sysid_bench.gap.refit import linear_fit
from sysid_bench.gap.screen import screen
from sysid_bench.gap.workflow import find_gap
from sysid_bench.nouns import Model, Record

SAMPLES, FIRST_SEED = 10_000, 3000
KINDS = ("single", "double", "none", "parameters", "unknown")
AIMS = {"one": (2, 10), "three": (4, 20), "eight": (15, 60)}  # median, worst, s
SCREENING = 0.3  # s, three DOFs
START = (
    "import time; t = time.process_time(); import sysid_bench.gap.workflow; print(time.process_time() - t)"
)
FIRST = (
    "import time; import numpy as np; from sysid_bench.effects import effect_class as e; "
    "from sysid_bench.gap.workflow import find_gap; from sysid_bench.nouns import Model, Record; "
    "from sysid_bench.mechanics.nonlinear import simulate; from sysid_bench.nouns import Plant; "
    "rng = np.random.default_rng(0); u = rng.normal(size=(600, 1)); t = time.process_time(); "
    "p = Plant([[1.0]], [[0.3]], [[1.0]], effects=(e('coulomb_friction')(0, 0.3), e('input_delay')(0, 0.1))); "
    "y = simulate(p, u, 0.1, 'zoh').y; r = Record(0.1 * np.arange(600), u, y, 'zoh'); "
    "find_gap([r], [r], Model([[1.0]], [[0.3]], [[1.0]])); print(time.process_time() - t)"
)


def cases(size: str, kind: str, count: int):
    """(records of training, of the test, model): the drawn trials that have the right length."""
    seed = FIRST_SEED
    while count:
        seed += 1
        draw = Draw(seed, kind=kind, size=size)
        if draw.N != SAMPLES:
            continue
        trial = draw.trial()
        if trial.truth["bad"]:
            continue
        count -= 1
        model = Model(
            trial.M, trial.D, trial.K, input_map=trial.L, output_map=trial.C, hold=trial.hold,
            initial_state=trial.initial_state,
        )  # fmt: skip
        records = [
            Record(np.arange(len(u)) * trial.h, u, y, trial.hold) for u, y in (trial.train, trial.test)
        ]
        yield records[:1], records[1:], model


def taken(train, test, model) -> float:
    begun = time.process_time()
    find_gap(train, test, model)
    return time.process_time() - begun


def screening(train, model) -> float:
    """Seconds of one screen of all suspects at all places, the best of three."""
    problem = prepared(train, model, check_data(train))[0]
    linear = linear_fit(problem)
    catalogue = [effect_class(name) for name in names()]
    spent = []
    for _ in range(3):
        begun = time.process_time()
        screen(problem, linear, catalogue)
        spent.append(time.process_time() - begun)
    return min(spent)


def in_a_new_process(code: str, **environment: str) -> float:
    env = {**os.environ, **environment}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
    return float(done.stdout.split()[-1])


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 6
    print(f"start-up (imports)               {in_a_new_process(START):6.2f} s")
    with tempfile.TemporaryDirectory() as empty:
        first = in_a_new_process(FIRST, NUMBA_CACHE_DIR=empty)
        again = in_a_new_process(FIRST, NUMBA_CACHE_DIR=empty)
        print(f"first call on a machine compiles {first - again:6.2f} s, kept for later processes")
    spent = [screening(train, model) for train, _, model in cases("three", "single", 4)]
    print(f"screening, three DOFs            {np.median(spent):6.2f} s (aim {SCREENING})")
    for size, (median, worst) in AIMS.items():
        spent = []
        for kind in KINDS if count else ():
            spent += (times := [taken(*case) for case in cases(size, kind, count)])
            print(f"{size:6s}{kind:11s}{told(times)}", flush=True)
        if spent:
            print(f"{size:6s}{'all':11s}{told(spent)} (aims {median}, {worst})", flush=True)


def told(times: list[float]) -> str:
    return f"{len(times):3d} cases: median {np.median(times):6.2f} s, worst {max(times):6.2f} s"


if __name__ == "__main__":
    main()
