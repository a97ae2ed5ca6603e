"""frames from the host, ticks of its own clock -> frames of the device. No input or output of its own.

States: idle -arm-> armed -start-> running -stop-> idle; anything -> fault -clear-> idle. The force is zero in
all states but running. At tick k of a run the device takes force k out of its store and answers with sample k.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sysid_bench.emulator.hardware import Hardware
from sysid_bench.emulator.motion import Motion
from sysid_bench.frames.codec import Codec, Decoded
from sysid_bench.frames.counter import unwrap
from sysid_bench.frames.frame import Frame
from sysid_bench.nouns import Array

MOVES = {"clear": ("fault", "idle"), "arm": ("idle", "armed"), "start": ("armed", "running")}


class Device:
    """One emulated rig. Times in s; `tick` counts the device's clock in units of rig.tick_unit_s."""

    def __init__(self, rig: Any, motion: Motion, hardware: Hardware) -> None:
        self.rig, self._motion, self._hardware = rig, motion, hardware
        self._rng = np.random.default_rng(hardware.seed)
        self.stuck: dict[int, float] = {}
        self.reset()

    def reset(self) -> None:
        """As after power-on; the plant goes on moving."""
        self._codec: Codec = self.rig.codec()
        self.state, self.fault, self.k, self.missed = "idle", "none", 0, 0
        self.force = np.zeros(len(self.rig.input_channels))
        self._store: dict[str, dict[int, dict[str, float]]] = {m: {} for m in self.rig.force_messages}
        self._alive_at = self._forced_at = 0.0
        self.y = np.zeros(len(self.rig.output_channels))

    def receive(self, frame: Frame, now: float) -> list[Frame]:
        """Take a frame from the host; the frames that it calls for."""
        decoded = self._codec.decode(frame)
        if decoded is None:
            return []
        if decoded.message == self.rig.emergency_stop["message"]:
            return self._drop("emergency_stop")
        if not decoded.intact:
            return []
        if self.rig.heartbeat in (None, decoded.message):
            self._alive_at = now
        if decoded.message in self._store:
            self._put(decoded)
        return self._request(decoded, now)

    def _put(self, decoded: Decoded) -> None:
        if self.rig.counter is None:
            self._store[decoded.message] = {-1: decoded.values}
        elif self.state in ("armed", "running"):
            bits = self.rig.bits(decoded.message, self.rig.counter)
            k = unwrap(int(decoded.values[self.rig.counter]), bits, self.k)
            if k >= self.k:
                self._store[decoded.message][k] = decoded.values

    def _request(self, decoded: Decoded, now: float) -> list[Frame]:
        for word, frames in self.rig.requests.items():
            for wanted in frames:
                if wanted["message"] == decoded.message and _matches(
                    decoded.values, wanted.get("signals") or {}
                ):
                    return self._obey(word, now)
        return []

    def _obey(self, word: str, now: float) -> list[Frame]:
        if word == "stop" and self.state != "fault":
            self._enter("idle")
        elif word in MOVES and self.state == MOVES[word][0]:
            self._enter(MOVES[word][1])
            self._alive_at = self._forced_at = now
            if word == "arm":
                self.k = self.missed = 0
                self._store = {m: {} for m in self._store}
            if word == "clear":
                self.fault = "none"
        else:
            return []
        return self.state_frames()

    def _enter(self, state: str) -> None:
        self.state = state
        if state != "running":
            self.force = np.zeros_like(self.force)

    def _drop(self, reason: str) -> list[Frame]:
        """Into fault: zero force at once."""
        first = self.state != "fault"
        self._enter("fault")
        if not first:
            return []
        self.fault = reason
        self._store = {m: {} for m in self._store}
        return self.state_frames() + self._fault_frames()

    def _fault_frames(self) -> list[Frame]:
        announce = (self.rig.fault or {}).get("announce")
        return (
            [self._codec.encode(announce["message"], {announce["signal"]: self._fault_code()})]
            if announce
            else []
        )

    def _fault_code(self) -> int:
        rule = self.rig.fault or {}
        codes = rule.get("codes", {})
        return rule.get("none", 0) if self.fault == "none" else codes.get(self.fault, codes.get("other", 1))

    def state_frames(self) -> list[Frame]:
        """The state message."""
        rule, fault = self.rig.state, self.rig.fault
        values = {rule["signal"]: rule.get(self.state, rule["idle"])}
        if fault and fault["message"] == rule["message"]:
            values[fault["signal"]] = self._fault_code()
        return [self._codec.encode(rule["message"], values)]

    def sample(self, now: float, tick: int, dt: float) -> list[Frame]:
        """The device's tick: the plant moves for dt under the force held, then force k is taken, sample k sent."""
        if dt > 0:
            self._motion.advance(self._hardware.actuate(self.force), dt)
        frames = self._watch(now)
        if self.state != "running":
            self.y = self._measure()
            return frames + ([] if self.rig.numbered else self._feedback(tick, {}))
        missed = self._take_force(now)
        self.y = self._measure()
        if np.abs(self.force).max() > 1.001 * self.rig.force_limit:
            return frames + self._drop("force_limit")
        frames += self._sync(tick) + self._feedback(tick, missed)
        self.k += 1
        return frames

    def _watch(self, now: float) -> list[Frame]:
        if self.state not in ("armed", "running"):
            return []
        if now - self._alive_at > self.rig.watchdog_s:
            return self._drop("host_silent")
        if self.state == "running" and self.rig.numbered and now - self._forced_at > self.rig.watchdog_s:
            return self._drop("no_force")
        return []

    def _take_force(self, now: float) -> dict[str, bool]:
        """Force k from the store; a message that is not there leaves its channels as they are, and is counted."""
        key = self.k if self.rig.numbered else -1
        found = {
            m: self._store[m].pop(key, None) if self.rig.numbered else self._store[m].get(key)
            for m in self._store
        }
        for i, channel in enumerate(self.rig.input_channels):
            values = found[channel.message]
            if values is not None:
                self.force[i] = values[channel.signal] * channel.scale
        missed = {m: values is None for m, values in found.items()}
        self.missed += sum(missed.values())
        if not all(missed.values()):
            self._forced_at = now
        return missed

    def _measure(self) -> Array:
        y = self._hardware.sense(self._motion.outputs(self._hardware.actuate(self.force)), self._rng)
        for channel in self.stuck:
            y[channel] = self.stuck[channel]
        return y

    def _sync(self, tick: int) -> list[Frame]:
        if self.rig.sync is None:
            return []
        values = {self.rig.counter: self.k, self.rig.tick: tick, self.rig.missed: self.missed}
        return [self._encode(self.rig.sync, values)]

    def _feedback(self, tick: int, missed: Mapping[str, bool]) -> list[Frame]:
        by_message: dict[str, dict[Any, float]] = {m: {} for m in self.rig.feedback_messages}
        for i, channel in enumerate(self.rig.output_channels):
            by_message[channel.message][channel.signal] = self.y[i] / channel.scale
        for i, channel in enumerate(self.rig.velocity_channels):
            by_message[channel.message][channel.signal] = self._motion.velocities()[i] / channel.scale
        gaps = list(missed.values())
        for i, values in enumerate(by_message.values()):
            gap = gaps[i] if len(gaps) == len(by_message) else any(gaps)
            values |= {self.rig.counter: self.k, self.rig.tick: tick, self.rig.missed: gap}
        return [self._encode(message, values) for message, values in by_message.items()]

    def _encode(self, message: str, values: Mapping[Any, float]) -> Frame:
        """Counters wrap and values saturate as the signal's bits allow."""
        fitted = {}
        for signal in self._codec.database.get_message_by_name(message).signals:
            if signal.name in values:
                fitted[signal.name] = _fit(signal, values[signal.name], signal.name not in self._counters())
        return self._codec.encode(message, fitted)

    def _counters(self) -> tuple[str | None, ...]:
        return self.rig.counter, self.rig.tick, self.rig.missed


def _fit(signal: Any, value: float, saturates: bool) -> float:
    if not saturates:
        return int(value) % (1 << signal.length)
    if signal.is_float:
        return float(value)
    low, high = (
        (-(1 << signal.length - 1), (1 << signal.length - 1) - 1)
        if signal.is_signed
        else (0, (1 << signal.length) - 1)
    )
    return float(np.clip(value, low * signal.scale + signal.offset, high * signal.scale + signal.offset))


def _matches(values: Mapping[str, float], wanted: Mapping[str, float]) -> bool:
    return all(values.get(name) == value for name, value in wanted.items())
