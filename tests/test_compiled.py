"""Compiled loops: kept across processes, in a folder of their own where no other can be written."""

import os
import subprocess
import sys
from pathlib import Path

from sysid_bench.mechanics.compiled import cache_folder, is_compiled, writable

CALL = """
import sys
import numpy as np
from sysid_bench.mechanics import paths
from sysid_bench.mechanics.compiled import is_compiled
before = is_compiled(paths.lag)
paths.lag(np.zeros((4, 3, 1)), 0.1, np.zeros(1))
print(before, is_compiled(paths.lag), sum(paths.lag.stats.cache_hits.values()))
"""


def run(environment):
    env = {**os.environ, **environment}
    return subprocess.run([sys.executable, "-c", CALL], env=env, capture_output=True, text=True, check=True)


def test_a_second_process_finds_what_the_first_compiled(tmp_path):
    here = {"NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(Path(__file__).parents[1])}
    assert run(here).stdout.split() == ["False", "True", "0"]
    assert run(here).stdout.split() == ["True", "True", "1"]


def test_where_nothing_can_be_written_a_temporary_folder_serves(tmp_path, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    file = tmp_path / "file"
    file.write_text("")  # no folder can be made below a file
    assert not writable(file / "cache")
    assert cache_folder(file / "beside", tmp_path / "own", tmp_path) is None
    found = cache_folder(file / "beside", file / "own", tmp_path / "temporary")
    assert found is not None and found.parent == tmp_path / "temporary"
    assert writable(found)


def test_a_plain_function_says_nothing():
    assert is_compiled(type("Function", (), {"signatures": []})())
