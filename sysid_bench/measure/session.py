"""frames and time -> frames to send: the host's side of a run, step by step, without input or output of its own.

find the device -> make it idle -> arm -> fill its store of forces -> start -> run -> stop -> done. Anything
unexpected raises Stopped; who drives the session then sends the emergency stop.
"""

from __future__ import annotations

from typing import Any, Protocol

from sysid_bench.frames.codec import Decoded
from sysid_bench.frames.frame import BUS_OFF, Frame
from sysid_bench.frames.load import classic_bits
from sysid_bench.measure.arrivals import Arrivals
from sysid_bench.measure.commands import Commands
from sysid_bench.measure.limits import Stopped, Watch
from sysid_bench.measure.samples import Assembler, Sample
from sysid_bench.nouns import InputError

ANSWER_S = 1.2
OBEY_S = 1.5
REPEAT_S = 0.1


class Sink(Protocol):
    """Who is told what happens."""

    def sample(self, sample: Sample) -> None: ...
    def state(self, state: str, fault: str) -> None: ...
    def command(self, k: int, u: Any) -> None: ...
    def feedback(self, decoded: Decoded, k: int) -> None: ...


class Session:
    """One run on one rig. `now` is the host's monotonic clock, s."""

    def __init__(
        self, rig: Any, plan: Commands, watch: Watch, silence_s: float, sink: Sink, where: str
    ) -> None:
        self.rig, self._plan, self._watch, self._sink = rig, plan, watch, sink
        self._silence_s, self._where = silence_s, where
        self.codec = rig.codec()
        self.samples = (Assembler if rig.numbered else Arrivals)(rig, plan.u)
        self.phase, self.state, self.fault = "find", None, "none"
        self.foreign = self.error_frames = 0
        self._started = False
        self._since = self._asked = self._heard = self._sampled = self._state_at = self._beat = (
            self._token
        ) = 0.0
        self._next_force = 0
        self._frame_s = 2 * classic_bits(8) / rig.bitrate_bps

    @property
    def done(self) -> bool:
        return self.phase == "done"

    def receive(self, frame: Frame, now: float) -> None:
        """Take a frame of the bus. Raises Stopped."""
        if frame.error:
            self.error_frames += 1
            if frame.id & BUS_OFF:
                raise Stopped("bus-off: the controller has left the bus")
            return
        decoded = self.codec.decode(frame)
        if decoded is None or decoded.message in self.rig.host_messages:
            self.foreign += 1
            return
        self._heard = now
        if decoded.message == self.rig.state["message"]:
            self._take_state(decoded, now)
        elif decoded.message in (*self.rig.feedback_messages, self.rig.sync):
            self._take_sample(decoded, now)

    def _take_state(self, decoded: Decoded, now: float) -> None:
        if not decoded.intact:
            self.samples.counts["corrupted"] += 1
            return
        self.state = self.rig.state_of(decoded.values[self.rig.state["signal"]])
        self._state_at = now
        rule = self.rig.fault
        if rule and rule["message"] == decoded.message:
            code = decoded.values[rule["signal"]]
            words = {number: word for word, number in rule.get("codes", {}).items()}
            self.fault = "none" if code == rule.get("none", 0) else words.get(code, f"code {code:g}")
            if self.fault != "none":
                self.state = "fault"
        self._sink.state(self.state, self.fault)
        if self.phase in ("run", "stop") and self.state == "fault":
            raise Stopped(f"device fault: {self.fault.replace('_', ' ')}")
        if self.phase == "run" and self.state != "running":
            raise Stopped(f"the device left the run by itself: it says {self.state} (was it reset?)")

    def _take_sample(self, decoded: Decoded, now: float) -> None:
        if self.phase not in ("start", "run", "stop") or (self.phase == "start" and not self.rig.numbered):
            return
        k = self.samples.add(decoded)
        if k is None:
            return
        self._sampled = now
        if decoded.message != self.rig.sync:
            self._sink.feedback(decoded, k)
            self._check(decoded, k)
        for sample in self.samples.ready():
            self._sink.sample(sample)

    def _check(self, decoded: Decoded, k: int) -> None:
        for i, channel in enumerate(self.rig.output_channels):
            if channel.message == decoded.message:
                self._watch.position(i, k, decoded.values[channel.signal] * channel.scale)
        for i, channel in enumerate(self.rig.velocity_channels):
            if channel.message == decoded.message:
                self._watch.velocity(i, k, decoded.values[channel.signal] * channel.scale)

    def step(self, now: float) -> list[Frame]:
        """What to send now. Raises InputError where no rig answers, Stopped where the run must end."""
        if not self._started:
            self._started = True
            self._enter("find", now)
            self._heard = now
        frames = self._heartbeat(now)
        if self.phase != "find" and now - self._heard > self._silence_s:
            raise Stopped(f"the device is silent: no frame for {now - self._heard:.2f} s")
        return frames + getattr(self, f"_{self.phase}")(now)

    def _enter(self, phase: str, now: float) -> None:
        self.phase, self._since, self._asked = phase, now, 0.0

    def _heartbeat(self, now: float) -> list[Frame]:
        if (
            self.rig.heartbeat is None
            or now - self._beat < self.rig.heartbeat_s
            or self.phase in ("find", "done")
        ):
            return []
        self._beat = now
        return [self.codec.encode(self.rig.heartbeat, {})]

    def _find(self, now: float) -> list[Frame]:
        if self.state is None:
            if now - self._since > ANSWER_S:
                raise InputError(self._nobody())
        elif self.state == "running":
            raise InputError(
                f"rig {self.rig.name} on {self._where} is running already: another host drives it. Stop that one first."
            )
        else:
            self._enter("clear" if self.state == "fault" else "quiet", now)
        return []

    def _nobody(self) -> str:
        seen = f"{self.foreign} frames of other identifiers" if self.foreign else "no frame at all"
        if self.samples.counts["corrupted"]:
            seen = f"{self.samples.counts['corrupted']} frames with a wrong checksum"
        return (
            f"rig {self.rig.name} does not answer on {self._where}: {seen} in {ANSWER_S:g} s; wanted "
            f"{self.rig.state['message']}. Is it on, on this bus, at {self.rig.bitrate_bps:.0f} bit/s, and the right DBC?"
        )

    def _ask(self, word: str, wanted: str, then: str, now: float) -> list[Frame]:
        """Send a request until the device's state is the one wanted."""
        if self._asked and self.state == wanted and self._state_at > self._asked:
            self._enter(then, now)
            return []
        if now - self._since > OBEY_S:
            fault = "" if self.fault == "none" else f", fault {self.fault.replace('_', ' ')}"
            raise Stopped(f"the device does not obey `{word}`: it stays {self.state}{fault}")
        if now - self._asked < REPEAT_S:
            return []
        self._asked = now
        return self.rig.request_frames(self.codec, word)

    def _idle_word(self) -> str:
        return self.rig.state_of(self.rig.state["idle"])

    def _clear(self, now: float) -> list[Frame]:
        return self._ask("clear", self._idle_word(), "arm", now)

    def _quiet(self, now: float) -> list[Frame]:
        return self._ask("stop", self._idle_word(), "arm", now)

    def _arm(self, now: float) -> list[Frame]:
        return self._ask("arm", "armed", "fill", now)

    def _fill(self, now: float) -> list[Frame]:
        frames = self._forces(now, self.rig.lead_samples)
        if self._next_force >= min(self.rig.lead_samples, self._plan.total):
            self._enter("start", now)
        return frames

    def _start(self, now: float) -> list[Frame]:
        frames = self._ask("start", "running", "run", now)
        if self.phase == "run" or self.samples.newest >= 0:
            self._enter("run", now)
            self._sampled = now
        return frames

    def _run(self, now: float) -> list[Frame]:
        if now - self._sampled > self._silence_s:
            raise Stopped(f"no samples for {now - self._sampled:.2f} s, though the device says {self.state}")
        if self.samples.newest >= self._plan.total - 1:
            self._enter("stop", now)
        return self._forces(now, self.samples.newest + 1 + self.rig.lead_samples)

    def _forces(self, now: float, target: int) -> list[Frame]:
        """Forces up to sample `target`, not faster than half the bus' speed."""
        frames: list[Frame] = []
        self._token = max(self._token, now - 0.05)
        while self._next_force < target and self._token <= now:
            k = self._next_force
            u = self._plan.u[min(k, self._plan.total - 1)]
            self._sink.command(k, u)
            frames += self._force_frames(k, u)
            self._next_force += 1
            self._token += self._frame_s * len(self.rig.force_messages)
        return frames

    def _force_frames(self, k: int, u: Any) -> list[Frame]:
        rig = self.rig
        values: dict[str, dict[str, float]] = {m: {} for m in rig.force_messages}
        for i, channel in enumerate(rig.input_channels):
            values[channel.message][channel.signal] = float(u[i]) / channel.scale
        if rig.counter:
            for message in values:
                values[message][rig.counter] = k % (1 << rig.bits(message, rig.counter))
        return [self.codec.encode(message, signals) for message, signals in values.items()]

    def _stop(self, now: float) -> list[Frame]:
        frames = (
            self._forces(now, self.samples.newest + 1 + self.rig.lead_samples)
            if self.state == "running"
            else []
        )
        frames += self._ask("stop", self._idle_word(), "done", now)
        if self.done:
            for sample in self.samples.flush():
                self._sink.sample(sample)
        return frames

    def _done(self, now: float) -> list[Frame]:
        return []
