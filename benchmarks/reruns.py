"""Is the regression check green where nothing changed? Re-runs of it under other roundings: BLAS threads and kernels,
SIMD of numpy, instruction sets of numba. Prints every environment that turns it red.

python benchmarks/reruns.py [count] [words of `sysid-bench check`]
"""

from __future__ import annotations

import itertools
import os
import random
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
# OpenBLAS kernel -> the processor flag that it needs.
KERNELS = {
    "Prescott": "pni", "Nehalem": "sse4_2", "Sandybridge": "avx", "Haswell": "avx2", "Zen": "avx2", "SkylakeX": "avx512f",
    "Cooperlake": "avx512_bf16", "ARMV8": "asimd", "NEOVERSEN1": "asimd",
}  # fmt: skip
NUMPY_WITHOUT = ("", "AVX512F", "AVX512F AVX2 FMA3")
NUMBA_CPU = ("", "generic")
THREADS = (1, 2, 4)


def processor_flags() -> set[str]:
    words = Path("/proc/cpuinfo").read_text().split() if Path("/proc/cpuinfo").exists() else []
    return set(words)


def environments() -> list[dict[str, str]]:
    """All combinations that this processor can run, in a fixed random order."""
    flags = processor_flags()
    kernels = ["", *(name for name, flag in KERNELS.items() if flag in flags)]
    names = ("OPENBLAS_NUM_THREADS", "OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES", "NUMBA_CPU_NAME")
    found = [
        {name: str(value) for name, value in zip(names, values) if value}
        for values in itertools.product(THREADS, kernels, NUMPY_WITHOUT, NUMBA_CPU)
    ]
    return random.Random(1).sample(found, len(found))


def rerun(changes: dict[str, str], words: list[str]) -> tuple[bool, str]:
    """(green, what it said) of one check under a changed environment."""
    env = {**os.environ, "PYTHONPATH": str(REPOSITORY), **changes}
    command = [sys.executable, "-m", "sysid_bench", "check", *words]
    done = subprocess.run(command, cwd=REPOSITORY, env=env, capture_output=True, text=True)
    return done.returncode == 0 and " 0 numbers worse, 0 better" in done.stdout, done.stdout + done.stderr


def reruns(count: int, words: list[str]) -> Iterator[tuple[dict[str, str], bool, str]]:
    for changes in itertools.islice(itertools.cycle(environments()), count):
        yield changes, *rerun(changes, words)


def main(count: int, words: list[str]) -> int:
    red = 0
    for number, (changes, green, said) in enumerate(reruns(count, words), 1):
        if not green:
            red += 1
            print(f"red under {changes}:\n{said}", flush=True)
        if number % 20 == 0 or number == count:
            print(
                f"{number} re-runs in {min(number, len(environments()))} environments: {red} red", flush=True
            )
    return 1 if red else 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if sys.argv[1:] else 6, sys.argv[2:]))
