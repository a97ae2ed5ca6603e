"""An emulator and a host as processes of their own, on a loopback bus of their own."""

from __future__ import annotations

import csv
import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

ENV = {
    **os.environ,
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONPATH": str(Path(__file__).parents[1]),
}
COMMAND = [sys.executable, "-m", "sysid_bench"]


def start(*words: str) -> subprocess.Popen:
    return subprocess.Popen(
        [*COMMAND, *words], env=ENV, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def free_port() -> int:
    return random.SystemRandom().randrange(20000, 60000)


@contextmanager
def emulator(
    *words: str, truth: Path | None = None, port: int | None = None, quiet: bool = False
) -> Iterator[str]:
    """A device on a bus of its own; gives the host's words for that bus."""
    bus = f"bus.port={port or free_port()}"
    process = start("emulate", bus, *words, *([f"truth={truth}"] if truth else []))
    try:
        line = process.stdout.readline()
        assert quiet or line.startswith("emulating"), line + process.stderr.read()
        yield bus
    finally:
        process.terminate()
        process.communicate(timeout=60)


def finish(process: subprocess.Popen, timeout: float = 180) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=timeout)
    return process.returncode, out, err


def measure(bus: str, out: Path, *words: str, timeout: float = 180) -> tuple[int, str, str]:
    return finish(start("measure", bus, f"out={out}", *words), timeout)


def truth_of(path: Path) -> list[dict[str, str]]:
    """Lines that the device wrote, whole ones only."""
    with open(path) as file:
        return [row for row in csv.DictReader(file) if None not in row.values()]


def running(path: Path) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Force and output by sample number of the last run."""
    found = {}
    for row in truth_of(path):
        if row["state"] == "running":
            numbers = {c: float(v) for c, v in row.items() if c[0] in "uy" and c[1:].isdigit()}
            u = [v for c, v in numbers.items() if c[0] == "u"]
            y = [v for c, v in numbers.items() if c[0] == "y"]
            found[int(row["k"])] = np.array(u), np.array(y)
    return found


def faults(*nodes: dict) -> str:
    """Hydra's words for a list of faults."""
    return "faults=" + json.dumps(list(nodes)).replace('"', "").replace(" ", "")


def wait_for(path: Path, size: int, seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not (path.exists() and path.stat().st_size > size):
        assert time.monotonic() < end, f"{path} did not grow"
        time.sleep(0.02)
