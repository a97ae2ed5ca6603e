"""The emulated device by itself: states, watchdog, exact motion, faults."""

import numpy as np
import pytest
from rig_bench import Bench, plant_named, rig_named, small_plan

from sysid_bench.emulator.device import Device
from sysid_bench.emulator.hardware import Hardware
from sysid_bench.emulator.motion import motion_of
from sysid_bench.mechanics.simulate import simulate

RIG, PLANT = rig_named("second_order"), plant_named("three_dof")


def running_device() -> tuple[Device, object]:
    device, codec = Device(RIG, motion_of(PLANT, 0.002), Hardware()), RIG.codec()
    for word in ("arm", "start"):
        if word == "start":
            device.receive(codec.encode("FORCE_1", {"force": 1.0, "k": 0}), 0.0)
        for frame in RIG.request_frames(codec, word):
            device.receive(frame, 0.0)
    device.sample(0.0, 0, 0.0)
    assert device.state == "running" and device.force[0] == 1.0
    return device, codec


def test_it_starts_only_from_armed() -> None:
    device, codec = Device(RIG, motion_of(PLANT, 0.002), Hardware()), RIG.codec()
    for frame in RIG.request_frames(codec, "start"):
        device.receive(frame, 0.0)
    assert device.state == "idle"


def test_the_force_is_zero_within_the_watchdog_time() -> None:
    device, codec = running_device()
    device.sample(RIG.watchdog_s - 0.001, 2000, 0.002)
    assert device.state == "running" and device.force[0] == 1.0
    device.sample(RIG.watchdog_s + 0.001, 4000, 0.002)
    assert (device.state, device.fault, device.force[0]) == ("fault", "host_silent", 0.0)
    for frame in RIG.request_frames(codec, "start"):
        device.receive(frame, 1.0)
    assert device.state == "fault"
    for frame in RIG.request_frames(codec, "clear"):
        device.receive(frame, 1.0)
    assert device.state == "idle"


def test_an_emergency_stop_needs_no_checksum() -> None:
    device, codec = running_device()
    device.receive(RIG.emergency_stop_frame(codec)._replace(data=b"\xff"), 0.1)
    assert (device.state, device.fault, device.force[0]) == ("fault", "emergency_stop", 0.0)


def test_a_corrupt_force_is_not_applied() -> None:
    device, codec = running_device()
    frame = codec.encode("FORCE_1", {"force": 5.0, "k": 1})
    device.receive(frame._replace(data=b"\x01" + frame.data[1:]), 0.001)
    device.sample(0.002, 2000, 0.002)
    assert device.force[0] == 1.0 and device.missed == 5


def test_a_force_above_the_limit_is_a_fault() -> None:
    device, codec = running_device()
    device.receive(codec.encode("FORCE_1", {"force": 1.5 * RIG.force_limit, "k": 1}), 0.001)
    device.sample(0.002, 2000, 0.002)
    assert (device.state, device.fault, device.force[0]) == ("fault", "force_limit", 0.0)


@pytest.mark.parametrize(
    ("name", "plant"),
    [("second_order_1", "one_dof"), ("second_order", "three_dof"), ("second_order_8_fd", "eight_dof")],
)
def test_a_run_is_the_exact_response_to_the_forces(name: str, plant: str) -> None:
    rig, plant = rig_named(name), plant_named(plant)
    bench = Bench(rig, plant, small_plan(rig, 400), hardware=Hardware()).run()
    assert bench.stopped is None and bench.session.done
    u = np.array([s.u for s in bench.samples[:400]])
    y = np.array([s.y for s in bench.samples[:400]])
    assert np.array_equal(u, bench.plan.u)
    exact = simulate(plant, u, 1 / rig.rate_hz, "zoh")
    assert np.abs(y - exact).max() <= 0.51e-6 * (1 if not rig.fd else np.abs(exact).max() + 1)
    assert not any(s.quality for s in bench.samples)


def test_drift_stretches_the_true_step_and_jitter_shows_in_the_tick() -> None:
    from sysid_bench.emulator.process import Clock

    clock = Clock(RIG, Hardware(drift_ppm=100.0))
    assert clock.instant(500) == (pytest.approx(1.0001), 1_000_000)
    clock = Clock(RIG, Hardware(jitter_s=2e-4))
    off = np.array([clock.instant(k)[1] - 2000 * k for k in range(1, 500)])
    assert 150 < np.abs(off).max() <= 200 and abs(off.mean()) < 20


def test_hardware_quantises_saturates_and_adds_noise() -> None:
    rng = np.random.default_rng(0)
    hardware = Hardware(quantisation=0.25, actuator_limit=1.0)
    assert hardware.sense(np.array([0.3, -0.4]), rng).tolist() == [0.25, -0.5]
    assert hardware.actuate(np.array([3.0, -0.5])).tolist() == [1.0, -0.5]
    y = np.array([Hardware(noise_rms=0.1).sense(np.zeros(2), rng) for _ in range(4000)])
    assert y.std() == pytest.approx(0.1, rel=0.05)


def test_effects_of_the_plant_are_felt() -> None:
    from dataclasses import replace

    from sysid_bench.effects.coulomb_friction import CoulombFriction

    rough = replace(PLANT, effects=(CoulombFriction(dof=0, force=0.5),))
    smooth_run = Bench(RIG, PLANT, small_plan(RIG, 300), hardware=Hardware()).run()
    rough_run = Bench(RIG, rough, small_plan(RIG, 300), hardware=Hardware()).run()
    gap = np.array([a.y - b.y for a, b in zip(smooth_run.samples, rough_run.samples)])
    assert np.abs(gap).max() > 1e-4
