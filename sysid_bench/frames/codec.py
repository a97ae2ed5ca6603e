"""numbers <-> frames by a DBC, with the alive counters and checksums that DBC files do not describe."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import cantools
from cantools.database.errors import Error as DbcError

from sysid_bench.frames.checksum import rule
from sysid_bench.frames.frame import Frame
from sysid_bench.nouns import InputError

MOST_BITS = 8 * 1785  # the longest message of SAE J1939, in several frames


class Decoded(NamedTuple):
    """A frame understood: message, physical values by signal, and whether length and checksum are right."""

    message: str
    values: dict[str, float]
    intact: bool
    time: float


@dataclass(frozen=True)
class Guard:
    """Which signals carry alive counter and checksum, and the checksum's rule.

    A message without these signals is not guarded. The checksum covers the two bytes of the identifier
    (low first; where with_id) and the payload without the checksum's own byte.
    """

    alive: str | None = None
    checksum: str | None = None
    rule: str = "crc8_j1850"
    with_id: bool = True


@dataclass
class Codec:
    """Encode and decode the messages of one database; counts its own alive counters as it encodes."""

    database: Any
    guard: Guard
    _alive: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._by_id = {m.frame_id: m for m in self.database.messages}
        self._by_name = {m.name: m for m in self.database.messages}
        self._crc = rule(self.guard.rule)
        self._crc_byte = {m.frame_id: _crc_byte(m, self.guard.checksum) for m in self.database.messages}

    def encode(self, name: str, values: Mapping[str, float]) -> Frame:
        """The frame of a message; signals not given are zero. Raises InputError where a value has no room."""
        message = self._by_name[name]
        full = dict.fromkeys(message.signal_tree, 0) | dict(values)
        guard = self.guard
        if guard.alive in full:
            bits = message.get_signal_by_name(guard.alive).length
            full[guard.alive] = self._alive[name] = (self._alive.get(name, -1) + 1) % (1 << bits)
        try:
            data = message.encode(full, padding=False, strict=True)
        except KeyError as word:
            raise InputError(
                f"message {name} cannot carry {dict(values)!r:.200}: {word} is no value's name."
            ) from None
        except (DbcError, OverflowError, ValueError, TypeError) as problem:
            raise InputError(f"message {name} cannot carry {dict(values)!r:.200}: {problem}") from None
        place = self._crc_byte[message.frame_id]
        if place is not None:
            data = data[:place] + bytes([self._checksum(message.frame_id, data, place)]) + data[place + 1 :]
        return Frame(message.frame_id, data, message.is_fd, message.is_extended_frame)

    def decode(self, frame: Frame) -> Decoded | None:
        """None for a frame that the database does not know."""
        message = self._by_id.get(frame.id)
        if message is None or frame.error:
            return None
        if len(frame.data) < message.length:
            return Decoded(message.name, {}, False, frame.time)
        values = message.decode(frame.data, decode_choices=False)
        place = self._crc_byte[frame.id]
        intact = place is None or frame.data[place] == self._checksum(frame.id, frame.data, place)
        return Decoded(message.name, values, intact, frame.time)

    def _checksum(self, frame_id: int, data: bytes, place: int) -> int:
        head = bytes((frame_id & 0xFF, frame_id >> 8 & 0xFF)) if self.guard.with_id else b""
        return self._crc(head + data[:place] + data[place + 1 :])


def load_database(text: str, name: str) -> Any:
    """The database of a DBC text. Raises InputError."""
    if excess := next((size for size in _sizes(text) if size > MOST_BITS), None):
        raise InputError(
            f"{name}: a message or signal of {excess} bits is longer than any on a CAN bus ({MOST_BITS})."
        )
    try:
        database: Any = cantools.database.load_string(text, "dbc", strict=True)
        for message in database.messages:  # a float of one bit shows only where it is read
            message.decode(bytes(message.length), decode_choices=False)
        return database
    except (DbcError, ValueError, KeyError, IndexError, AttributeError) as problem:
        reason = " ".join(str(problem).split())
        raise InputError(f"{name} is no DBC file that can be read: {reason[:300]}") from None


def _sizes(text: str) -> Iterator[int]:
    """Bits of every message, first bit and bits of every signal, read off the text: a parser would make room for them."""
    yield from (8 * int(size[:9]) for size in re.findall(r"\bBO_\s+\d+\s+\w+\s*:\s*(\d+)", text))
    for place in re.findall(r"\bSG_[^:\n]*:\s*(\d+)\s*\|\s*(\d+)", text):
        yield from (int(number[:9]) for number in place)


def _crc_byte(message: Any, signal_name: str | None) -> int | None:
    """Index of the checksum's byte. Raises InputError where the signal is not one whole byte."""
    signal = next((s for s in message.signals if s.name == signal_name), None)
    if signal is None:
        return None
    start = signal.start if signal.byte_order == "little_endian" else signal.start - 7
    if signal.length != 8 or start % 8:
        raise InputError(
            f"the checksum {message.name}.{signal.name} must fill one byte; it has {signal.length} bits at bit {signal.start}."
        )
    return start // 8
