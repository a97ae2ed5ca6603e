"""Another device is only a DBC and a yaml: the ODrive rig through the same session, in simulated time."""

import numpy as np
import pytest
from rig_bench import Bench, plant_named, rig_named, small_plan

from sysid_bench.emulator.faults import Fault
from sysid_bench.emulator.hardware import Hardware

RIG, PLANT = rig_named("odrive_simple"), plant_named("one_dof")
N = 300


def bench(*faults: Fault) -> Bench:
    return Bench(RIG, PLANT, small_plan(RIG, N), faults, Hardware()).run()


def test_a_clean_run_pairs_each_sample_with_the_torque_in_effect() -> None:
    run = bench()
    assert run.stopped is None and run.session.done and len(run.samples) >= N
    y = {k: y for k, (_, y) in run.truth.items()}
    first = next(k for k in y if np.isclose(y[k], run.samples[5].y, rtol=1e-6, atol=0).all()) - 5
    for s in run.samples[1:N]:
        u_true, y_true = run.truth[first + s.k]
        assert np.allclose(s.y, y_true, rtol=1e-6)
        assert np.array_equal(s.u, u_true)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (Fault("silence", at_sample=100), "silent"),
        (Fault("device_reset", at_sample=100), "left the run by itself"),
        (Fault("bus_off", at_sample=100), "bus-off"),
    ],
)
def test_faults_end_a_run(fault: Fault, words: str) -> None:
    run = bench(fault)
    assert run.stopped and words in run.stopped and len(run.samples) < N


def test_its_watchdog_is_fed_by_torques() -> None:
    run = bench(Fault("drop", "force", at_sample=50))
    assert run.stopped == "device fault: host silent"
    assert run.device.state == "fault" and not run.device.force.any()


def test_the_emergency_stop_disarms_with_its_own_error_code() -> None:
    run = bench()
    run.device.receive(RIG.emergency_stop_frame(RIG.codec()), 100.0)
    (frame,) = run.device.state_frames()
    values = RIG.codec().decode(frame).values
    assert (values["Axis_Error"], values["Axis_State"]) == (33554432, 1)  # ESTOP_REQUESTED, IDLE
