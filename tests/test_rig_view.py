"""The live view takes every sample, and rerun finds its recording sound."""

import subprocess
import sys
from pathlib import Path

import numpy as np
from rig_bench import rig_named

from sysid_bench.measure.samples import Sample
from sysid_bench.views.rerun_live import LiveView

RERUN = Path(sys.executable).with_name("rerun")


def test_samples_arrive_in_the_recording(tmp_path: Path) -> None:
    rig = rig_named("second_order")
    view = LiveView(rig, tmp_path / "live.rrd")
    for k in range(60):
        view.sample(Sample(k, 2000 * k, 0.002 * k, np.full(3, 0.5), np.arange(3.0) + k, 0))
    view.close()
    words = [RERUN, "rrd", "stats", tmp_path / "live.rrd"]
    stats = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    verify = subprocess.run([RERUN, "rrd", "verify", tmp_path / "live.rrd"], capture_output=True, check=False)
    assert verify.returncode == 0
    printed = subprocess.run(
        [RERUN, "rrd", "print", "-v", tmp_path / "live.rrd"], capture_output=True, text=True
    ).stdout
    for entity in ("/y/1", "/y/3", "/u/2"):
        assert entity in printed, stats
