"""Blind over the bus: a hidden effect in the emulated rig, measured over CAN, named by the workflow, then the seal opened.

    python experiments/hidden_effects/blind.py --out results/gap

Under five minutes: two runs of 40 s over a loopback bus. Exit code 0 where name and place are right.
"""

from __future__ import annotations

import argparse
import json
import secrets
import subprocess
import sys
from pathlib import Path

import numpy as np
import yaml

SECONDS = 40
PLANT = "three_dof"
# Sizes for a plant with springs of 4 N/m that moves by about half a metre under 1 N rms.
DRAWS = {
    "coulomb_friction": lambda g: {"force": g.uniform(0.1, 0.3), "speed": 0.002},
    "quadratic_drag": lambda g: {"coefficient": g.uniform(0.3, 1.0)},
    "cubic_stiffness": lambda g: {"stiffness": g.uniform(1.5, 5.0)},
    "dead_zone": lambda g: {"stiffness": g.uniform(1.5, 3.0), "gap": g.uniform(0.08, 0.2)},
    "backlash": lambda g: {"stiffness": g.uniform(1.5, 3.0), "gap": g.uniform(0.06, 0.15)},
    "bouc_wen_hysteresis": lambda g: {"stiffness": g.uniform(1.0, 2.5), "yield_displacement": g.uniform(0.1, 0.3)},
    "end_stop": lambda g: {"stiffness": g.uniform(15, 40), "gap": g.uniform(0.25, 0.45), "side": float(g.choice([-1, 0, 1]))},
    "extra_mode": lambda g: {"mass": g.uniform(0.1, 0.3), "frequency": g.uniform(0.2, 0.5), "damping_ratio": 0.04},
    "constant_force": lambda g: {"force": g.uniform(0.2, 0.6) * g.choice([-1, 1])},
    "actuator_lag": lambda g: {"time_constant": g.uniform(0.03, 0.12)},
}  # fmt: skip


def draw(seed: int) -> dict:
    rng = np.random.default_rng(seed)
    name = str(rng.choice(list(DRAWS)))
    dof = int(rng.integers(3))
    return {"name": name, "dof": dof, "parameters": {k: float(v) for k, v in DRAWS[name](rng).items()}}


def command(words: list[str]) -> list[str]:
    print("$ sysid-bench " + " ".join(words), flush=True)
    return [sys.executable, "-m", "sysid_bench", *words]


def call(words: list[str]) -> None:
    if subprocess.run(command(words), check=False).returncode != 0:
        raise SystemExit(f"failed: {words[0]}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/gap"))
    parser.add_argument("--seed", type=int, default=None)
    given = parser.parse_args()
    out, seed = given.out, secrets.randbelow(2**31) if given.seed is None else given.seed
    out.mkdir(parents=True, exist_ok=True)
    sealed = out / "sealed.yaml"
    sealed.write_text(yaml.safe_dump({"effects": [draw(seed)]}))
    from sysid_bench.build import build
    from sysid_bench.conf import option
    from sysid_bench.files import write_model

    write_model(build(option("plant", PLANT)).model(), out / "model.yaml")
    bus = [f"bus.port={20000 + secrets.randbelow(40000)}"]
    for name, number in (("train", 1), ("test", 2)):
        device = subprocess.Popen(
            command(["emulate", *bus, f"plant={PLANT}", f"effects={sealed}", f"hardware.seed={number}"]),
            stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            print(device.stdout.readline(), end="", flush=True)
            call(
                [
                    "measure",
                    *bus,
                    "excitation=cubic_noise",
                    f"seconds={SECONDS}",
                    f"seed={number}",
                    f"out={out / name}.mcap",
                ]
            )
        finally:
            device.terminate()
            device.communicate(timeout=20)
    call(["gap", f"train={out}/train.mcap", f"test={out}/test.mcap", f"model={out}/model.yaml", f"out={out}"])
    answer = json.loads((out / "gap.json").read_text())
    truth = yaml.safe_load(sealed.read_text())["effects"]
    print("\nthe seal is opened")
    print(f"  truth : {[(e['name'], e['dof'], e['parameters']) for e in truth]}")
    said = [
        (e["name"], e["dof"], {k: p["value"] for k, p in e["parameters"].items()}) for e in answer["effects"]
    ]
    print(f"  answer: {answer['verdict']} {said}")
    right = [(e["name"], e["dof"]) for e in truth] == [(name, dof) for name, dof, _ in said]
    print("right" if right else "WRONG")
    return 0 if right else 1


if __name__ == "__main__":
    sys.exit(main())
