"""frames on their way, sample number -> frames that arrive: what goes wrong on a bus or in a device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sysid_bench.emulator.device import Device
from sysid_bench.frames.frame import Frame, bus_off
from sysid_bench.nouns import InputError

FRAME_KINDS = ("drop", "duplicate", "reorder", "delay", "corrupt")
DEVICE_KINDS = ("stuck_sensor", "device_reset", "bus_off", "silence")


@dataclass(frozen=True)
class Fault:
    """One kind of trouble, from sample `at_sample` of a run for `count` samples (null: for good).

    kind         drop, duplicate, reorder (one sample later), delay (held, then sent in a burst), corrupt (one bit
                 flipped), stuck_sensor, device_reset, bus_off, silence
    frames       of the frame kinds: force, feedback, sync, state, all, or a message's name
    channel      of stuck_sensor: the output, counted from 0
    probability  that a frame of the window is hit
    run          the run it comes in, counted from 1 since the device was switched on; null: every run
    """

    kind: str
    frames: str = "feedback"
    at_sample: int = 0
    count: int | None = None
    probability: float = 1.0
    channel: int = 0
    run: int | None = None

    def __post_init__(self) -> None:
        if self.kind not in FRAME_KINDS + DEVICE_KINDS:
            raise InputError(
                f"fault kind must be one of {', '.join(FRAME_KINDS + DEVICE_KINDS)}; got {self.kind!r}."
            )
        if not 0 <= self.probability <= 1:
            raise InputError(
                f"fault {self.kind}: probability must be between 0 and 1; got {self.probability!r}."
            )

    def active(self, k: int) -> bool:
        """True at sample k of a run that it concerns."""
        return self.at_sample <= k and (self.count is None or k < self.at_sample + self.count)


@dataclass
class Injector:
    """Faults applied to the frames of a device, both ways; counts what it did, by kind."""

    rig: Any
    faults: Sequence[Fault]
    seed: int = 0
    done: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)
        self._name = {m.frame_id: m.name for m in self.rig.database.messages}
        self._held: list[tuple[int, Frame]] = []
        self.offline = False
        self.run = 0
        known = {"force", "feedback", "sync", "state", "all", *self._name.values()}
        for fault in self.faults:
            if fault.frames not in known:
                raise InputError(
                    f"fault {fault.kind}: frames={fault.frames!r}; wanted one of {', '.join(sorted(known))}."
                )

    def _concerns(self, fault: Fault, name: str) -> bool:
        rig = self.rig
        groups = {"force": rig.force_messages, "feedback": rig.feedback_messages, "sync": (rig.sync,)}
        groups |= {"state": (rig.state["message"],), "all": (name,)}
        return name in groups.get(fault.frames, (fault.frames,))

    def _count(self, kind: str) -> None:
        self.done[kind] = self.done.get(kind, 0) + 1

    def before_sample(self, device: Device) -> list[Frame]:
        """Faults of the device itself, before it takes the sample of its present number; frames they cause."""
        if device.state != "running":
            return []
        self.run += device.k == 0
        for fault in self._present():
            if fault.kind == "stuck_sensor":
                self._stick(fault, device)
            elif fault.kind in DEVICE_KINDS and fault.at_sample == device.k:
                self._count(fault.kind)
                if fault.kind == "device_reset":
                    device.reset()
                    return device.state_frames()
                self.offline = True
                return [bus_off()] if fault.kind == "bus_off" else []
        return []

    def _present(self) -> list[Fault]:
        return [fault for fault in self.faults if fault.run in (None, self.run)]

    def _stick(self, fault: Fault, device: Device) -> None:
        if fault.active(device.k):
            if fault.channel not in device.stuck:
                self._count(fault.kind)
            device.stuck.setdefault(fault.channel, device.y[fault.channel])
        else:
            device.stuck.pop(fault.channel, None)

    def release(self, k: int) -> list[Frame]:
        """Held frames that are due before those of sample k."""
        due = [frame for when, frame in self._held if when <= k]
        self._held = [(when, frame) for when, frame in self._held if when > k]
        return due

    def release_all(self) -> list[Frame]:
        """All that is held: a run has ended."""
        frames, self._held = [frame for _, frame in self._held], []
        return frames

    def passing(self, frame: Frame, k: int) -> list[Frame]:
        """What becomes of a frame of sample k; k < 0: no run, nothing happens."""
        name = self._name.get(frame.id)
        if name is None or k < 0:
            return [frame]
        for fault in self._present():
            if fault.kind in FRAME_KINDS and fault.active(k) and self._concerns(fault, name):
                if self._rng.random() < fault.probability:
                    self._count(fault.kind)
                    return self._hit(fault, frame, k)
        return [frame]

    def _hit(self, fault: Fault, frame: Frame, k: int) -> list[Frame]:
        if fault.kind == "drop":
            return []
        if fault.kind == "duplicate":
            return [frame, frame]
        if fault.kind == "corrupt":
            return [_flipped(frame, self._rng)]
        if fault.kind == "reorder":  # after the frames of the next sample, before those of the one after
            self._held.append((k + 2, frame))
        else:
            self._held.append((fault.at_sample + (fault.count or 1), frame))
        return []


def _flipped(frame: Frame, rng: np.random.Generator) -> Frame:
    """One bit wrong: what slips past a controller's own check is rarer, but looks like this."""
    bit = int(rng.integers(8 * len(frame.data)))
    data = bytearray(frame.data)
    data[bit // 8] ^= 1 << bit % 8
    return frame._replace(data=bytes(data))
