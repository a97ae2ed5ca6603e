"""DBC file and yaml -> what a device speaks: channels, states, requests, limits, bus load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from sysid_bench.frames.codec import Codec, Guard, load_database
from sysid_bench.frames.frame import Frame
from sysid_bench.frames.load import Load, Stream
from sysid_bench.nouns import OUTPUTS, InputError

PACKAGE = Path(__file__).resolve().parent.parent
BESIDE = (PACKAGE.parent / "conf" / "rig", PACKAGE / "shipped" / "conf" / "rig")
BITRATES_BPS = (10_000, 20_000, 50_000, 83_333, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)
SLOWEST_HZ, FASTEST_HZ = 1e-3, 1e6
STATES = ("idle", "armed", "running", "fault")
REQUESTS = ("clear", "arm", "start", "stop")


class Channel(NamedTuple):
    """One input or output: physical value of the signal times `scale` is the number in `unit`."""

    message: str
    signal: str
    scale: float
    unit: str


@dataclass(frozen=True)
class Rig:
    """A device on a CAN bus. See docs/your_rig.md for every knob; inconsistent ones raise InputError.

    The DBC is looked for as given, then beside the rigs that come with the suite.
    """

    name: str
    dbc: str
    bitrate_bps: float
    rate_hz: float
    inputs: Sequence[Mapping[str, Any]]
    outputs: Sequence[Mapping[str, Any]]
    state: Mapping[str, Any]
    requests: Mapping[str, Sequence[Mapping[str, Any]]]
    emergency_stop: Mapping[str, Any]
    fd: bool = False
    data_bitrate_bps: float = 4_000_000
    load_budget: float = 0.6
    output: str = "displacement"
    velocities: Sequence[Mapping[str, Any]] = ()
    sync: str | None = None
    counter: str | None = None
    tick: str | None = None
    tick_unit_s: float = 1e-6
    missed: str | None = None
    alive: str | None = None
    checksum: str | None = None
    checksum_rule: str = "crc8_j1850"
    checksum_with_id: bool = True
    fault: Mapping[str, Any] | None = None
    heartbeat: str | None = None
    heartbeat_s: float = 0.02
    state_period_s: float = 0.02
    watchdog_s: float = 0.5
    lead_samples: int = 100
    force_limit: float = 10.0
    force_rate_limit: float = 2000.0
    position_limit: float = 5.0
    velocity_limit: float = 50.0

    def __post_init__(self) -> None:
        self._check_numbers()
        if self.output not in OUTPUTS:
            raise self._wrong(f"output must be one of {', '.join(OUTPUTS)}; got {self.output!r}")
        if not self.inputs or not self.outputs:
            raise self._wrong("at least one input and one output channel are wanted")
        for role, message, signals in self._references():
            self._check_reference(role, message, signals)
        missing = [word for word in ("arm", "start", "stop") if not self.requests.get(word)]
        if missing:
            raise self._wrong(f"requests must say how to {', '.join(missing)}")
        if self.fd != any(m.is_fd for m in self.database.messages):
            kind = "CAN FD" if not self.fd else "only classic"
            raise self._wrong(f"fd is {self.fd}, but {self.dbc} has {kind} frames; set fd to fit the DBC")

    def _wrong(self, problem: str) -> InputError:
        return InputError(f"rig {self.name}: {problem}.")

    def _check_numbers(self) -> None:
        if self.bitrate_bps not in BITRATES_BPS:
            known = ", ".join(str(b) for b in BITRATES_BPS)
            raise self._wrong(
                f"bitrate_bps must be one that controllers offer ({known}); got {self.bitrate_bps}"
            )
        names = (
            "rate_hz data_bitrate_bps load_budget tick_unit_s heartbeat_s state_period_s watchdog_s lead_samples "
            "force_limit force_rate_limit position_limit velocity_limit"
        )
        for name in names.split():
            if not getattr(self, name) > 0:
                raise self._wrong(f"{name} must be positive; got {getattr(self, name)!r}")
        if not SLOWEST_HZ <= self.rate_hz <= FASTEST_HZ:
            raise self._wrong(f"rate_hz must be {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz; got {self.rate_hz!r}")
        if self.heartbeat and 2 * self.heartbeat_s > self.watchdog_s:
            raise self._wrong(
                f"watchdog_s {self.watchdog_s} must be at least twice heartbeat_s {self.heartbeat_s}"
            )

    def _references(self) -> list[tuple[str, str, list[str]]]:
        """(role, message, signals) for everything that the yaml names."""
        found = [(f"input {i + 1}", c["message"], [c["signal"]]) for i, c in enumerate(self.inputs)]
        found += [(f"output {i + 1}", c["message"], [c["signal"]]) for i, c in enumerate(self.outputs)]
        found += [(f"velocity {i + 1}", c["message"], [c["signal"]]) for i, c in enumerate(self.velocities)]
        found += [("state", self.state["message"], [self.state["signal"]])]
        found += [("sync", self.sync, [])] if self.sync else []
        found += [("heartbeat", self.heartbeat, [])] if self.heartbeat else []
        for role, node in (("fault", self.fault), ("fault.announce", (self.fault or {}).get("announce"))):
            found += [(role, node["message"], [node["signal"]])] if node else []
        stop = self.emergency_stop
        found += [("emergency_stop", stop["message"], list(stop.get("signals") or {}))]
        for word, frames in self.requests.items():
            found += [(f"request {word}", f["message"], list(f.get("signals") or {})) for f in frames]
        return found

    def _check_reference(self, role: str, message: str, signals: list[str]) -> None:
        known = {m.name: [s.name for s in m.signals] for m in self.database.messages}
        if message not in known:
            raise self._wrong(f"{role} wants message {message!r}; {self.dbc} has {', '.join(known)}")
        for signal in signals:
            if signal not in known[message]:
                has = ", ".join(known[message]) or "no signals"
                raise self._wrong(
                    f"{role} wants signal {signal!r} of message {message}; {self.dbc} gives it {has}"
                )

    @cached_property
    def dbc_path(self) -> Path:
        places = [Path(self.dbc).expanduser(), *(folder / self.dbc for folder in BESIDE)]
        for path in places:
            if path.is_file():
                return path
        raise self._wrong(f"no DBC file {self.dbc!r}; looked at {', '.join(str(p) for p in places)}")

    @cached_property
    def dbc_text(self) -> str:
        return self.dbc_path.read_bytes().decode("latin-1")

    @cached_property
    def database(self) -> Any:
        return load_database(self.dbc_text, str(self.dbc_path))

    def codec(self) -> Codec:
        """A fresh codec, alive counters at their start: one per end of the bus."""
        return Codec(
            self.database, Guard(self.alive, self.checksum, self.checksum_rule, self.checksum_with_id)
        )

    @cached_property
    def input_channels(self) -> tuple[Channel, ...]:
        return tuple(_channel(c) for c in self.inputs)

    @cached_property
    def output_channels(self) -> tuple[Channel, ...]:
        return tuple(_channel(c) for c in self.outputs)

    @cached_property
    def velocity_channels(self) -> tuple[Channel, ...]:
        return tuple(_channel(c) for c in self.velocities)

    @cached_property
    def force_messages(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(c.message for c in self.input_channels))

    @cached_property
    def feedback_messages(self) -> tuple[str, ...]:
        channels = (*self.output_channels, *self.velocity_channels)
        return tuple(dict.fromkeys(c.message for c in channels))

    @cached_property
    def host_messages(self) -> frozenset[str]:
        """Messages that the host sends; all others are the device's."""
        names = {self.emergency_stop["message"], *self.force_messages}
        names |= {f["message"] for frames in self.requests.values() for f in frames}
        return frozenset(names | ({self.heartbeat} if self.heartbeat else set()))

    def ids(self, host: bool) -> frozenset[int]:
        """Identifiers of the frames that the host (or the device) sends."""
        return frozenset(m.frame_id for m in self.database.messages if (m.name in self.host_messages) == host)

    @property
    def numbered(self) -> bool:
        """True where forces and feedback carry the sample counter."""
        return self.counter is not None

    def bits(self, message: str, signal: str) -> int:
        return self.database.get_message_by_name(message).get_signal_by_name(signal).length

    def has(self, message: str, signal: str | None) -> bool:
        return signal in self.database.get_message_by_name(message).signal_tree

    def state_of(self, value: float) -> str:
        """The word of a state's number; running wins where idle and armed share one; else fault."""
        for word in ("running", "armed", "idle"):
            if value in _as_list(self.state.get(word)):
                return word
        return "fault"

    def emergency_stop_frame(self, codec: Codec) -> Frame:
        return codec.encode(self.emergency_stop["message"], self.emergency_stop.get("signals") or {})

    def request_frames(self, codec: Codec, word: str) -> list[Frame]:
        return [codec.encode(f["message"], f.get("signals") or {}) for f in self.requests.get(word, ())]

    def load(self) -> Load:
        """Every frame of a run, worst case."""
        sizes = {m.name: (m.length, m.is_fd) for m in self.database.messages}
        per_sample = [*([self.sync] if self.sync else []), *self.force_messages, *self.feedback_messages]
        slow = [(self.state["message"], self.state_period_s)]
        slow += [(self.heartbeat, self.heartbeat_s)] if self.heartbeat else []
        grouped: dict[tuple, list[str]] = {}
        for name in per_sample:
            grouped.setdefault((name.rstrip("0123456789").rstrip("_"), *sizes[name]), []).append(name)
        streams = [
            Stream(name, size, self.rate_hz, len(names), fd) for (name, size, fd), names in grouped.items()
        ]
        streams += [Stream(name, *_size(sizes[name], 1 / period)) for name, period in slow]
        return Load(tuple(streams), self.bitrate_bps, self.data_bitrate_bps, self.rate_hz)

    def check_load(self) -> Load:
        """The load. Raises InputError above the budget."""
        load = self.load()
        load.check(
            self.load_budget,
            "" if self.fd else "; CAN FD carries all channels of a sample in one frame (rig=second_order_fd)",
        )
        return load


def _size(size: tuple[int, bool], rate_hz: float) -> tuple[int, float, int, bool]:
    return size[0], rate_hz, 1, size[1]


def _channel(node: Mapping[str, Any]) -> Channel:
    return Channel(node["message"], node["signal"], float(node.get("scale", 1.0)), str(node.get("unit", "")))


def _as_list(value: Any) -> Sequence[Any]:
    return () if value is None else value if isinstance(value, (list, tuple)) else (value,)
