"""device, bus, clock -> an emulated rig that answers until it is told to end."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, TextIO

import numpy as np

from sysid_bench.emulator.device import Device
from sysid_bench.emulator.faults import Fault, Injector
from sysid_bench.emulator.hardware import Hardware
from sysid_bench.emulator.motion import motion_of
from sysid_bench.frames.link import Link, send_all
from sysid_bench.nouns import InputError, Plant

BREATH = 0.1  # of a sampling step


class Clock:
    """The device's sampling instants: true time (s since the start) and its own tick."""

    def __init__(self, rig: Any, hardware: Hardware) -> None:
        self._h, self._unit = 1 / rig.rate_hz, rig.tick_unit_s
        self._stretch = 1 + 1e-6 * hardware.drift_ppm
        self._jitter = hardware.jitter_s
        if not self._jitter < self._h / 2:
            raise InputError(
                f"hardware.jitter_s={self._jitter:g} must be below half a sample, {self._h / 2:g} s."
            )
        self._rng = np.random.default_rng([hardware.seed, 1])

    def instant(self, number: int) -> tuple[float, int]:
        """(true time in s, tick) of a sampling instant."""
        own = number * self._h
        if self._jitter and number:
            own += self._rng.uniform(-self._jitter, self._jitter)
        tick = round(own / self._unit)
        own = tick * self._unit if self._jitter else own
        return own * self._stretch, tick


class Emulator:
    """The device on its bus, with its faults; `truth` gets one line per sample, for tests and scoring only."""

    def __init__(
        self,
        rig: Any,
        plant: Plant,
        hardware: Hardware,
        faults: Sequence[Fault],
        link: Link,
        truth: TextIO | None,
    ) -> None:
        _check_channels(rig, plant)
        link.own = rig.ids(host=False)
        self.rig, self._link, self._truth = rig, link, truth
        self._clock = Clock(rig, hardware)
        self._step = (1 / rig.rate_hz) * (1 + 1e-6 * hardware.drift_ppm)
        self._jitter = hardware.jitter_s > 0
        self.device = Device(rig, motion_of(plant, self._step), hardware)
        self.injector = Injector(rig, faults, hardware.seed)
        if truth:
            channels = [f"u{i + 1}" for i in range(plant.nu)] + [f"y{i + 1}" for i in range(plant.ny)]
            print("time,state,fault,k,tick," + ",".join(channels), file=truth)

    def run(self, until: Callable[[], bool]) -> None:
        """Answer until `until()` is true. Raises LinkLost."""
        start, number, true, state_at = self._link.now(), 0, 0.0, 0.0
        due, tick = self._clock.instant(0)
        while not until():
            # late ticks are caught up with, but never back to back: the host must get its turn in between
            self._link.sleep(max(start + due - self._link.now(), BREATH * self._step))
            while self._listen():  # a controller holds what comes between two ticks
                pass
            # without jitter to the bit the same step each time: its matrix exponential is kept
            step = due - true if self._jitter else self._step
            self._tick(due, tick, step if number else 0.0)
            if due >= state_at:
                self._send(self.device.state_frames())
                state_at += self.rig.state_period_s
            true, number = due, number + 1
            due, tick = self._clock.instant(number)

    def _number(self) -> int:
        return self.device.k if self.device.state == "running" else -1

    def _listen(self) -> bool:
        """Take one frame that has come; False where there is none."""
        frame = self._link.recv(0.0)
        if frame is None:
            return False
        if self.injector.offline:
            return True
        now = self._link.now()
        for arrived in self.injector.passing(frame, self._number()):
            self._send(self.device.receive(arrived, now))
        return True

    def _tick(self, due: float, tick: int, dt: float) -> None:
        device, k = self.device, self.device.k
        self._send(self.injector.before_sample(device), always=True)
        running = device.state == "running"
        late = self.injector.release(k) if running else self.injector.release_all()
        for frame in late:
            if frame.id in self.rig.ids(host=True):
                device.receive(frame, self._link.now())
            else:
                self._send([frame])
        for frame in device.sample(self._link.now(), tick, dt):
            self._send(self.injector.passing(frame, k if running else -1))
        if self._truth and device.state != "idle":
            self._note(due, tick, k)

    def _send(self, frames: Sequence[Any], always: bool = False) -> None:
        if always or not self.injector.offline:
            send_all(self._link, frames)

    def _note(self, due: float, tick: int, k: int) -> None:
        device = self.device
        numbers = [*device.force, *device.y]
        words = [
            repr(time.monotonic()),
            device.state,
            device.fault,
            str(k),
            str(tick),
            *(repr(float(x)) for x in numbers),
        ]
        print(",".join(words), file=self._truth)


def _check_channels(rig: Any, plant: Plant) -> None:
    wanted, found = (len(rig.input_channels), len(rig.output_channels)), (plant.nu, plant.ny)
    if wanted != found:
        raise InputError(
            f"rig {rig.name} has {wanted[0]} inputs and {wanted[1]} outputs, the plant {found[0]} and {found[1]}. "
            "Choose the rig by the plant: rig=second_order_1, second_order (3) or second_order_8."
        )
    if rig.output != plant.output:
        raise InputError(f"rig {rig.name} measures {rig.output}, the plant's output is {plant.output}.")
