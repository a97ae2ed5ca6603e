"""What the engine adds to a cell: overhead, cells per second, memory of the parent against the number of cells.

python benchmarks/engine.py [cells ...]
"""

from __future__ import annotations

import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

NOTHING = '''
"""settings -> nothing: a cell that costs nothing, so that the engine is what is measured."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Nothing:
    """Answers one number."""

    value: float = 0.0

    def compute(self, plant, sampling, rng):
        return {"value": self.value + rng.random()}
'''
RUNS = 3


def make_plugin(folder: Path) -> None:
    (folder / "trivial").mkdir()
    (folder / "trivial" / "__init__.py").write_text('"""A trivial analysis."""\n')
    (folder / "trivial" / "nothing.py").write_text(NOTHING)
    (folder / "conf" / "analysis").mkdir(parents=True)
    (folder / "conf" / "analysis" / "nothing.yaml").write_text(
        "_target_: trivial.nothing.Nothing\nvalue: 0.0\n"
    )


def sweep(folder: Path, cells: int, executor: str, name: str) -> tuple[float, float]:
    """(s of wall clock, MiB of the parent at most) of one sweep through the command line."""
    words = [
        "sweep", f"plugins={folder}", f"study.name={name}", "study.kind=analysis", "analysis=nothing",
        f"study.repetitions={cells}", "views=false", f"executor={executor}",
    ]  # fmt: skip
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    start = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "sysid_bench", *words], cwd=folder, env=env, stdout=subprocess.DEVNULL
    )
    peak = 0.0
    while process.poll() is None:
        peak = max(peak, _resident_mib(process.pid))
        time.sleep(0.05)
    assert process.returncode == 0
    return time.perf_counter() - start, peak


def _resident_mib(pid: int) -> float:
    try:
        found = re.search(r"VmHWM:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text())
    except OSError:
        return 0.0
    return int(found[1]) / 1024 if found else 0.0


def main(counts: list[int]) -> None:
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        make_plugin(folder)
        for executor in ("serial", "local"):
            start_up = statistics.median(
                sweep(folder, 1, executor, f"one_{executor}_{k}")[0] for k in range(RUNS)
            )
            print(f"{executor}: start-up with one cell {start_up:.2f} s (median of {RUNS})")
            for cells in counts:
                seconds, peak = sweep(folder, cells, executor, f"many_{executor}_{cells}")
                each = 1e3 * (seconds - start_up) / cells
                print(
                    f"{executor}: {cells} cells in {seconds:.1f} s: {each:.2f} ms of overhead a cell, "
                    f"{cells / seconds:.0f} cells/s, parent at most {peak:.0f} MiB"
                )


if __name__ == "__main__":
    main([int(word) for word in sys.argv[1:]] or [1000, 10000])
