"""Machines that others measured: what is known to be missing is found. Skipped by name where the data are absent."""

import sys
from pathlib import Path

import pytest

from sysid_bench.gap.story import Rules
from sysid_bench.gap.workflow import find_gap

STUDY = Path(__file__).parent.parent / "experiments" / "measured_machines"


@pytest.fixture
def answer():
    sys.path.insert(0, str(STUDY))
    import convert

    sys.path.remove(str(STUDY))

    def of(name):
        machine, root = convert.MACHINES[name], convert.data_root()
        if root is None or not (root / machine.folder).is_dir():
            pytest.skip(f"{name}: no {machine.folder}/ in the folder that SYSID_BENCH_DATA names")
        found = convert.records(machine, root)
        train, test = ([found[n] for n in names] for names in (machine.train, machine.test))
        return find_gap(
            train, test, convert.nominal(machine), rules=Rules(most_on_force=machine.most), power=False
        )

    return of


def test_positioning_system_all_four_in_the_order_of_their_size(answer):
    found = answer("positioning_system")
    names = [e.name for e in found.added]
    assert names == ["coulomb_friction", "asymmetric_friction", "input_delay", "position_ripple"]
    _, _, delay, ripple = found.added
    assert delay.delay == pytest.approx(0.5e-3, rel=0.1)
    assert ripple.pitch == pytest.approx(2.5e-3, rel=2e-3)
    gaps = found.force_gaps
    assert gaps["refitted"] > 0.16 and gaps["better"] < 0.037
    assert gaps["better"] > 3 * gaps["floor"]  # and what is left is said: it is no noise


def test_friction_damper_play_and_friction_are_told_apart(answer):
    found = answer("friction_damper")
    assert [e.name for e in found.added] == ["friction_behind_play"]
    assert found.added[0].force == pytest.approx(10.4e3, rel=0.05)
    assert found.added[0].gap == pytest.approx(2.2e-3, rel=0.1)
    left = {c.effect.name: c.fit.rho for c in found.story.rounds[0].contenders}
    assert left["friction_behind_play"] < 0.5 * left["presliding_friction"]
    assert found.force_gaps["better"] < 0.13


def test_flexible_link_clipped_drive_and_hidden_mode(answer):
    found = answer("flexible_link")
    assert {f.name for f in found.check.drives} == {"saturation"}
    modes = [e for e in found.added if e.path == "structure"]
    assert [e.name for e in modes] == ["extra_mode"]
    assert modes[0].frequency == pytest.approx(2.5, rel=0.05)
    assert found.force_gaps["better"] < 1.2 * found.force_gaps["floor"]


def test_robot_axis_coulomb_friction(answer):
    found = answer("robot_axis")
    assert [e.name for e in found.added] == ["coulomb_friction"]
    assert found.added[0].force == pytest.approx(1.5, rel=0.1)
    assert found.force_gaps["better"] < 0.65 * found.force_gaps["refitted"]
