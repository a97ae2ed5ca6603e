"""Measured machines -> what the gap workflow says of them. Data: SYSID_BENCH_DATA, else ../shared/data.

    python experiments/measured_machines/machines.py emps axis

emps  electro-mechanical positioning system (Janot, Gautier, Brunot 2019): closed loop, 1 kHz, a mass without a spring
axis  first axis of a 6-axis robot (Weigand 2021): torque and angle at 250 Hz, three trajectories
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np

from sysid_bench.gap.choose import Rules
from sysid_bench.gap.workflow import Answer, find_gap
from sysid_bench.nouns import Model, Record

DATA = Path(os.environ.get("SYSID_BENCH_DATA", "../shared/data"))
DRIVE_GAIN = 35.15  # N/V, from the authors' scripts
# A machine is never clean: smaller effects count, and four of them are looked for.
RULES = Rules(most=4, practical=0.003, second_share=0.15)


def arrays(name: str) -> dict[str, np.ndarray]:
    with np.load(DATA / name, allow_pickle=False) as file:
        return {key: file[key] for key in file.files if key != "meta"}


def record(t, u, y) -> Record:
    step = float(np.median(np.diff(t)))
    return Record(step * np.arange(len(t)), u[:, None], y[:, None], hold="zoh")


def emps() -> Answer:
    runs = []
    for name in ("emps_train", "emps_test_pulses"):
        d = arrays(f"emps/{name}.npz")
        runs.append(record(d["t"].ravel(), DRIVE_GAIN * d["vir"].ravel(), d["qm"].ravel()))
    model = Model([[95.0]], [[200.0]], [[0.0]], hold="zoh")
    return find_gap(runs[:1], runs[1:], model, rules=RULES, tell=print, power=False)


def axis() -> Answer:
    runs = []
    for name in ("A", "B"):
        d = arrays(f"kuka_weigand/traj_{name}.npz")
        runs.append(record(d["t"].ravel(), d["tau_Nm"][0], np.deg2rad(d["q_mot_deg"][0])))
    model = Model([[10.0]], [[10.0]], [[0.0]], hold="zoh")
    return find_gap(runs[:1], runs[1:], model, rules=RULES, tell=print, power=False)


def main() -> int:
    for name in sys.argv[1:] or ["emps"]:
        try:
            answer = {"emps": emps, "axis": axis}[name]()
        except FileNotFoundError as problem:
            print(
                f"{name}: skipped, the data are absent ({problem.filename}); see experiments/measured_machines"
            )
            continue
        print(f"{name}: {answer.verdict.word}: {answer.verdict.reason}")
        for effect in answer.story.fit.point.effects:
            sizes = ", ".join(f"{k} {getattr(effect, k):.4g} {effect.knobs[k].unit}" for k in effect.numeric)
            print(f"  {effect.name}: {sizes}")
        gaps = answer.force_gaps or {}
        print("  held-out force error: " + ", ".join(f"{k} {100 * v:.2f} %" for k, v in gaps.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
