"""rig: emulator and host as two processes, the record identified, the estimate held against the plant."""

from __future__ import annotations

import secrets
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any, Literal

from sysid_bench.asked import require
from sysid_bench.build import build
from sysid_bench.files import read_estimate, write_model
from sysid_bench.nouns import Array, Estimate, Plant

FAR = 4.5  # standard errors: the largest of 18 entries lies beyond once in some 10 000 runs


def main(cfg: dict[str, Any]) -> int:
    """0: measured, identified, and every entry of M, D, K within 4.5 standard errors of the plant's."""
    require(cfg, "rig", "out")
    plant = build(cfg["plant"], cfg["plugins"].packages)
    out = Path(cfg["out"])
    out.mkdir(parents=True, exist_ok=True)
    write_model(plant.model().structure_only(), out / "model.yaml")
    bus = [
        f"bus.port={cfg['port'] or 20000 + secrets.randbelow(40000)}",
        f"rig={cfg['rig']}",
        f"pace={cfg['pace']}",
    ]
    log = out / "run.mcap"
    with emulated(["emulate", *bus, *_device(cfg), f"truth={out / 'device.csv'}"]):
        run = [
            "measure",
            *bus,
            f"excitation={cfg['excitation']}",
            f"seconds={cfg['seconds']}",
            f"seed={cfg['seed']}",
        ]
        if _call([*run, f"out={log}"]) != 0:
            return 1
    fit = [
        "identify",
        f"record={log}",
        f"model={out / 'model.yaml'}",
        f"method={cfg['method']}",
        f"out={out}",
    ]
    if _call(fit) != 0:
        return 1
    estimate, _ = read_estimate(out / "estimate.json")
    return compared(estimate, plant)


def _device(cfg: dict[str, Any]) -> list[str]:
    words = [f"plant={cfg['choices']['plant']}", f"hardware.noise_rms={cfg['noise_rms']}"]
    words += [f"hardware.drift_ppm={cfg['drift_ppm']}", f"hardware.seed={cfg['seed']}"]
    if cfg["drop"]:
        words.append(f"faults=[{{kind:drop,frames:feedback,probability:{cfg['drop']}}}]")
    return words


def _command(words: list[str]) -> list[str]:
    print(f"$ {shlex.join(['sysid-bench', *words])}", flush=True)
    return [sys.executable, "-m", "sysid_bench", *words]


def _call(words: list[str]) -> int:
    return subprocess.run(_command(words), check=False).returncode


@contextmanager
def emulated(words: list[str]) -> Iterator[None]:
    """The device process, from when it answers until it is ended."""
    device = subprocess.Popen(_command(words), stdout=subprocess.PIPE, text=True)
    try:
        assert device.stdout is not None
        print(device.stdout.readline(), end="", flush=True)
        yield
    finally:
        device.terminate()
        device.communicate(timeout=20)


def compared(estimate: Estimate, plant: Plant) -> int:
    """Print estimate, 95 % interval and truth entry by entry; 1 where one is far outside."""
    print(f"{'entry':>8} {'estimate':>12} {'+-':>10} {'plant':>8} {'errors / std':>13}")
    worst, inside, total = 0.0, 0, 0
    matrices: tuple[tuple[Literal["M", "D", "K"], Array | None, Array], ...] = (
        ("M", estimate.M, plant.mass),
        ("D", estimate.D, plant.damping),
        ("K", estimate.K, plant.stiffness),
    )
    for name, value, truth in matrices:
        std = estimate.std(name)
        if value is None or std is None:
            print(f"the estimate has no {name} with intervals; choose a method that gives both")
            return 1
        for i, j in combinations_with_replacement(range(plant.n), 2):
            off = (value[i, j] - truth[i, j]) / std[i, j]
            worst, total = max(worst, abs(off)), total + 1
            inside += abs(off) <= 1.96
            print(_line(name, i, j, value, std, truth, off))
    print(f"{inside} of {total} inside their 95 % intervals; the farthest is {worst:.1f} standard errors off")
    return 0 if worst < FAR else 1


def _line(name: str, i: int, j: int, value: Array, std: Array, truth: Array, off: float) -> str:
    entry = f"{name}[{i}][{j}]"
    return f"{entry:>8} {value[i, j]:12.6f} {1.96 * std[i, j]:10.6f} {truth[i, j]:8.3f} {off:13.2f}"
