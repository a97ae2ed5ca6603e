"""A device and a host in one process and in simulated time: the whole protocol, without a bus and without waiting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid_bench import conf
from sysid_bench.build import build
from sysid_bench.emulator.device import Device
from sysid_bench.emulator.faults import Fault, Injector
from sysid_bench.emulator.hardware import Hardware
from sysid_bench.emulator.motion import motion_of
from sysid_bench.emulator.process import Clock
from sysid_bench.frames.frame import Frame
from sysid_bench.measure.commands import Commands, carried
from sysid_bench.measure.limits import Stopped, Watch
from sysid_bench.measure.samples import Sample
from sysid_bench.measure.session import Session
from sysid_bench.nouns import Plant

STEP_S = 0.0005


def rig_named(name: str):
    return build(conf.option("rig", name))


def plant_named(name: str) -> Plant:
    return build(conf.option("plant", name))


def small_plan(rig, N: int, seed: int = 1, size: float = 1.0) -> Commands:
    u = size * np.random.default_rng(seed).uniform(-1, 1, (N, len(rig.input_channels)))
    return Commands(carried(rig, u), 0, N, None)


@dataclass
class Bench:
    """Runs a session against a device; keeps what both sides hold to be true."""

    rig: object
    plant: Plant
    plan: Commands
    faults: Sequence[Fault] = ()
    hardware: Hardware = field(default_factory=lambda: Hardware(noise_rms=1e-3))
    seed: int = 0
    stuck_s: float | None = 0.25
    samples: list[Sample] = field(default_factory=list)
    truth: dict[int, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    states: list[str] = field(default_factory=list)
    stopped: str | None = None

    def __post_init__(self) -> None:
        h = 1 / self.rig.rate_hz
        self.device = Device(self.rig, motion_of(self.plant, h), self.hardware)
        self.injector = Injector(self.rig, self.faults, self.seed)
        self.session = Session(self.rig, self.plan, Watch(self.rig, self.stuck_s), 0.4, self, "bench")
        self.clock = Clock(self.rig, self.hardware)
        self._to_host: list[Frame] = []

    def sample(self, sample: Sample) -> None:
        self.samples.append(sample)

    def state(self, state: str, fault: str) -> None:
        self.states.append(state)

    def command(self, k: int, u: np.ndarray) -> None: ...

    def feedback(self, decoded, k: int) -> None: ...

    def run(self, seconds: float = 60.0) -> Bench:
        """To the end, or to the stop; then the emergency stop, as the driver sends it."""
        number, true, state_at, now = 0, 0.0, 0.0, 0.0
        due, tick = self.clock.instant(0)
        try:
            while not self.session.done and now < seconds:
                if now >= due:
                    self._tick(now, tick, due - true)
                    if due >= state_at:
                        self._out(self.device.state_frames())
                        state_at += self.rig.state_period_s
                    true, number = due, number + 1
                    due, tick = self.clock.instant(number)
                self._exchange(now)
                now += STEP_S
        except Stopped as reason:
            self.stopped = str(reason)
            self.device.receive(self.rig.emergency_stop_frame(self.session.codec), now)
            self.samples.extend(self.session.samples.flush())
        return self

    def _tick(self, now: float, tick: int, dt: float) -> None:
        device, k = self.device, self.device.k
        self._out(self.injector.before_sample(device), always=True)
        running = device.state == "running"
        for frame in self.injector.release(k) if running else self.injector.release_all():
            if frame.id in self.rig.ids(host=True):
                device.receive(frame, now)
            else:
                self._out([frame])
        for frame in device.sample(now, tick, dt):
            self._out(self.injector.passing(frame, k if running else -1))
        if running:
            self.truth[k] = (device.force.copy(), device.y.copy())

    def _exchange(self, now: float) -> None:
        frames, self._to_host = self._to_host, []
        for frame in frames:
            self.session.receive(frame._replace(time=1000.0 + now), now)
        for frame in self.session.step(now):
            number = self.device.k if self.device.state == "running" else -1
            if not self.injector.offline:
                for arrived in self.injector.passing(frame, number):
                    self._out(self.device.receive(arrived, now))

    def _out(self, frames: Sequence[Frame], always: bool = False) -> None:
        if always or not self.injector.offline:
            self._to_host.extend(frames)
