"""A campaign: several excitations and sizes in a row, one record each; periods and repetitions."""

import contextlib
import io
from pathlib import Path

import numpy as np
import pytest
from rig_bench import rig_named
from rig_processes import emulator

from sysid_bench.__main__ import main
from sysid_bench.build import build
from sysid_bench.conf import option
from sysid_bench.measure.campaign import Campaign
from sysid_bench.measure.commands import commands
from sysid_bench.nouns import InputError
from sysid_bench.records import read_record

MINE = """# Two excitations.
_target_: sysid_bench.measure.campaign.Campaign
runs:
  - {name: noise, amplitude: 0.5, repetitions: 2}
  - {name: lines, excitation: {option: multisine, f_max_hz: 20.0}, seconds: 0.2, periods: 3}
pause_s: 0.1
"""


def test_a_campaign_writes_one_record_per_run(tmp_path: Path) -> None:
    (tmp_path / "plugin" / "conf" / "campaign").mkdir(parents=True)
    (tmp_path / "plugin" / "conf" / "campaign" / "mine.yaml").write_text(MINE)
    with emulator() as bus, contextlib.redirect_stdout(io.StringIO()):
        words = [f"plugins={tmp_path / 'plugin'}", "campaign=mine", "seconds=0.4", "soft_start_s=0.1"]
        code = main(["measure", bus, *words, f"out={tmp_path / 'run.mcap'}"])
    assert code == 0
    first, second, lines = (read_record(tmp_path / f"run_{n}.mcap") for n in ("noise_1", "noise_2", "lines"))
    assert (first.N, second.N, lines.N) == (200, 200, 300)
    assert not np.array_equal(first.u, second.u)  # repetitions have seeds of their own
    assert lines.period == 100 and np.array_equal(lines.u[:100], lines.u[200:])
    assert first.origin["config"]["amplitude"] == 0.5


@pytest.mark.parametrize(
    "runs", [[], [{"amplitude": 1.0}], [{"name": "a", "size": 2}], [{"name": "a"}, {"name": "a"}]]
)
def test_a_campaign_that_makes_no_sense_is_refused(runs: list) -> None:
    with pytest.raises(InputError):
        Campaign(runs)


def test_a_run_starts_and_ends_softly_at_zero() -> None:
    rig = rig_named("second_order")
    excitation = build(option("excitation", "cubic_noise"))
    plan = commands(excitation, rig, 2.0, 1, 1.0, 0.5, np.random.default_rng(1))
    assert (plan.first, plan.N, plan.total) == (250, 1000, 1501)
    step = np.abs(np.diff(plan.u, axis=0)).max()
    assert np.abs(plan.u[0]).max() < 1e-3 and not plan.u[-1].any()
    assert step < 0.05  # no jump anywhere, neither into the record nor out of it


def test_forces_are_those_that_the_frames_carry() -> None:
    rig = rig_named("second_order")
    plan = commands(
        build(option("excitation", "cubic_noise")), rig, 1.0, 1, 1.0, 0.0, np.random.default_rng(1)
    )
    codec = rig.codec()
    for k in (0, 77, 400):
        frame = codec.encode("FORCE_2", {"force": float(plan.u[k, 1]), "k": k})
        assert codec.decode(frame).values["force"] == plan.u[k, 1]
