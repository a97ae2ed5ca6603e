"""an opened python-can bus -> frames in and out, with its errors in our words."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterable
from typing import Any

from sysid_bench.frames.frame import Frame
from sysid_bench.nouns import InputError

BUFFER_BYTES = 8 * 2**20
SO_RCVBUFFORCE = 33  # above the system's limit, where allowed


class LinkLost(Exception):
    """The bus failed under a run: interface down, bus-off, buffer full, cable out."""


class Link:
    """Send and receive on one bus; `own` identifiers coming back are dropped.

    kernel_time: the bus stamps frames in the kernel, wall clock; else they are stamped here.
    pace: seconds on this link per real second; 1 but for emulated devices that run slower or faster.
    """

    def __init__(self, bus: Any, name: str, kernel_time: bool) -> None:
        self._bus, self.name, self._kernel_time = bus, name, kernel_time
        self.own: frozenset[int] = frozenset()
        self.pace = 1.0
        self._opened = time.time()

    def now(self) -> float:
        """s, monotonic, in the link's pace."""
        return self.pace * time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait, in the link's pace."""
        time.sleep(max(0.0, seconds) / self.pace)

    def send(self, frame: Frame) -> None:
        """Raises LinkLost where the bus does not take the frame."""
        import can

        message = can.Message(
            arbitration_id=frame.id, data=frame.data, is_fd=frame.fd, bitrate_switch=frame.fd,
            is_extended_id=frame.extended, is_error_frame=frame.error, check=False,
        )  # fmt: skip
        try:
            self._bus.send(message, timeout=0.1)
        except (can.CanError, OSError, ValueError) as problem:
            raise LinkLost(f"{self.name}: a frame cannot be sent ({problem}).") from None

    def recv(self, timeout_s: float) -> Frame | None:
        """The next frame, None after `timeout_s`. Raises LinkLost."""
        import can

        end = time.monotonic() + timeout_s / self.pace
        while True:
            try:
                message = self._bus.recv(max(0.0, end - time.monotonic()))
            except (can.CanError, OSError, ValueError) as problem:
                raise LinkLost(f"{self.name}: cannot receive ({problem}).") from None
            if message is None:
                return None
            if message.arbitration_id not in self.own or message.is_error_frame:
                return self._frame(message)

    def _frame(self, message: Any) -> Frame:
        stamp = message.timestamp if self._kernel_time else time.time()
        stamp = self._opened + self.pace * (stamp - self._opened)
        return Frame(
            message.arbitration_id, bytes(message.data), message.is_fd, message.is_extended_id,
            message.is_error_frame, stamp,
        )  # fmt: skip

    def drain(self) -> None:
        """Forget what has come in so far."""
        while self.recv(0.0) is not None:
            pass

    def close(self) -> None:
        self._bus.shutdown()


def enlarge_buffer(sock: socket.socket) -> None:
    """Room for what comes while this process waits for its turn: the kernel's usual 200 kB are 300 frames."""
    for option in (SO_RCVBUFFORCE, socket.SO_RCVBUF):
        try:
            sock.setsockopt(socket.SOL_SOCKET, option, BUFFER_BYTES)
            return
        except OSError:
            continue


def opened(bus: Any, rig: Any, pace: float) -> Link:
    """The link of a bus for a rig. Raises InputError, also for a pace that cannot be."""
    if not 1e-3 <= pace <= 1e6 or (pace != 1 and bus.moves_hardware):
        raise InputError(f"pace must be 0.001 to 1e6, and 1 for real hardware; got {pace!r}.")
    link = bus.open(rig)
    link.pace = float(pace)
    return link


def send_all(link: Link, frames: Iterable[Frame]) -> None:
    for frame in frames:
        link.send(frame)
