"""an opened python-can bus -> frames in and out, with its errors in our words."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any

from sysid_bench.frames.frame import Frame


class LinkLost(Exception):
    """The bus failed under a run: interface down, bus-off, buffer full, cable out."""


class Link:
    """Send and receive on one bus; `own` identifiers coming back are dropped.

    kernel_time: the bus stamps frames in the kernel, wall clock; else they are stamped here.
    """

    def __init__(self, bus: Any, name: str, kernel_time: bool) -> None:
        self._bus, self.name, self._kernel_time = bus, name, kernel_time
        self.own: frozenset[int] = frozenset()

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

        end = time.monotonic() + timeout_s
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


def send_all(link: Link, frames: Iterable[Frame]) -> None:
    for frame in frames:
        link.send(frame)
