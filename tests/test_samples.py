"""Whatever happens to the frames: no wrong sample without a flag, and the counts are right."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rig_bench import Bench, plant_named, rig_named, small_plan

from sysid_bench.emulator.faults import FRAME_KINDS, Fault
from sysid_bench.nouns import CORRUPTED, DUPLICATED, LOST, REORDERED

RIG, PLANT = rig_named("second_order"), plant_named("three_dof")
FD_RIG = rig_named("second_order_fd")
N = 400


def bench(*faults: Fault, rig=RIG, **options) -> Bench:
    return Bench(rig, PLANT, small_plan(rig, N), faults, **options).run()


def assert_never_wrong_without_a_flag(run: Bench) -> None:
    """Good samples are what the device did, to the resolution of the bus; numbers are in order and complete."""
    assert [s.k for s in run.samples] == list(range(len(run.samples)))
    uncertain = run.session.samples.counts["forces_uncertain"]
    for s in run.samples:
        u, y = run.truth[s.k]
        known = np.isfinite(s.y)
        assert np.abs(s.y - y)[known].max(initial=0) <= 0.51e-6 * (1 + np.abs(y).max())
        assert known.all() or s.quality & LOST
        if not uncertain:
            assert np.array_equal(s.u, u)


@pytest.mark.parametrize("rig", [RIG, FD_RIG])
def test_a_clean_run_has_no_flags(rig) -> None:
    run = bench(rig=rig)
    assert run.stopped is None and len(run.samples) >= N
    assert not any(s.quality for s in run.samples)
    assert_never_wrong_without_a_flag(run)


@pytest.mark.parametrize(
    ("kind", "bit", "name"),
    [
        ("drop", LOST, "lost"),
        ("duplicate", DUPLICATED, "duplicated"),
        ("reorder", REORDERED, "reordered"),
        ("corrupt", CORRUPTED, "corrupted"),
    ],
)
def test_each_fault_is_counted_and_flagged_where_it_was(kind: str, bit: int, name: str) -> None:
    count = 1 if kind == "reorder" else 3  # several in a row, each one late, stay in order
    run = bench(
        Fault(kind, "FEEDBACK_2", at_sample=50, count=count),
        Fault(kind, "FEEDBACK_3", at_sample=200, count=1),
    )
    assert run.stopped is None
    assert run.session.samples.counts[name] == run.injector.done[kind] == count + 1
    flagged = [s.k for s in run.samples if s.quality & bit]
    assert flagged == [*range(50, 50 + count), 200]
    assert_never_wrong_without_a_flag(run)


def test_missed_forces_are_known_exactly() -> None:
    run = bench(
        Fault("drop", "FORCE_2", at_sample=100, count=5),
        Fault("drop", "feedback", at_sample=120, count=120, probability=0.1),
    )
    assert run.session.samples.counts["forces_missed"] == 5
    assert run.session.samples.counts["forces_uncertain"] == 0
    assert_never_wrong_without_a_flag(run)


def test_a_burst_of_delay_loses_nothing() -> None:
    run = bench(Fault("delay", "feedback", at_sample=100, count=60))
    counts = run.session.samples.counts
    assert counts["lost"] == counts["too_late"] == 0 and run.injector.done["delay"] == 180
    late = [s.host_s - 1000.0 - 0.002 * s.k for s in run.samples]
    assert np.argmax(late) in (100, 101)  # the first of the burst waited longest; clock comparison flags it
    assert_never_wrong_without_a_flag(run)


def test_lost_sync_frames_do_no_harm() -> None:
    run = bench(Fault("drop", "sync", probability=0.3), Fault("drop", "force", probability=0.02))
    assert run.stopped is None and run.session.samples.counts["sync_lost"] > 50
    assert_never_wrong_without_a_flag(run)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (Fault("device_reset", at_sample=150), "left the run by itself"),
        (Fault("bus_off", at_sample=150), "bus-off"),
        (Fault("silence", at_sample=150), "silent"),
        (Fault("stuck_sensor", at_sample=150, channel=1), "stuck sensor: output 2"),
        (Fault("drop", "force", at_sample=150), "no force"),
        (Fault("drop", "feedback", at_sample=150), ""),
    ],
)
def test_faults_that_end_a_run(fault: Fault, words: str) -> None:
    run = Bench(RIG, PLANT, small_plan(RIG, 800), [fault]).run()
    if words:
        assert run.stopped and words in run.stopped
        assert len(run.samples) < 800
        assert run.device.state != "running" or fault.kind in ("bus_off", "silence")
    else:  # sync still tells the numbers: every sample is there and says that it is lost
        assert all(s.quality & LOST for s in run.samples[150:])
    if fault.kind != "stuck_sensor":
        assert_never_wrong_without_a_flag(run)


def test_position_and_velocity_limits_stop_the_run() -> None:
    import dataclasses

    tight = dataclasses.replace(RIG, position_limit=0.02)
    assert "position_limit" in (Bench(tight, PLANT, small_plan(tight, 2000, size=8.0)).run().stopped or "")
    tight = dataclasses.replace(RIG, velocity_limit=0.5)
    assert "velocity_limit" in (Bench(tight, PLANT, small_plan(tight, 3000, size=9.0)).run().stopped or "")


kinds = st.builds(
    Fault,
    kind=st.sampled_from(FRAME_KINDS),
    frames=st.sampled_from(["force", "feedback", "sync", "state", "all", "FEEDBACK_2", "FORCE_1"]),
    at_sample=st.integers(0, N),
    count=st.integers(1, 80),
    probability=st.sampled_from([0.02, 0.3, 1.0]),
)


sequences = given(
    st.lists(kinds, min_size=1, max_size=4),
    st.integers(0, 2**31),
    st.sampled_from(["second_order", "second_order_fd"]),
)


@settings(max_examples=12, deadline=None)
@sequences
def test_random_faults_never_give_a_wrong_sample_without_a_flag(
    faults: list[Fault], seed: int, name: str
) -> None:
    check_random_faults(faults, seed, name)


@pytest.mark.slow
@pytest.mark.full
@settings(max_examples=300, deadline=None)
@sequences
def test_many_random_faults(faults: list[Fault], seed: int, name: str) -> None:
    check_random_faults(faults, seed, name)


def check_random_faults(faults: list[Fault], seed: int, name: str) -> None:
    names = {"FEEDBACK_2": "FEEDBACK", "FORCE_1": "FORCE"} if name.endswith("fd") else {}
    faults = [
        Fault(f.kind, names.get(f.frames, f.frames), f.at_sample, f.count, f.probability) for f in faults
    ]
    run = Bench(rig_named(name), PLANT, small_plan(rig_named(name), N), faults, seed=seed).run()
    assert_never_wrong_without_a_flag(run)
    if run.stopped is None:
        assert len(run.samples) >= N
