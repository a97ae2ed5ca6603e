"""One frame on the bus, as both ends see it."""

from __future__ import annotations

from typing import NamedTuple

BUS_OFF = 0x40  # CAN_ERR_BUSOFF of linux/can/error.h, in the identifier of an error frame


class Frame(NamedTuple):
    """id, payload bytes, time of reception (s, host wall clock; 0 for a frame to be sent)."""

    id: int
    data: bytes
    fd: bool = False
    extended: bool = False
    error: bool = False
    time: float = 0.0


def bus_off() -> Frame:
    """The error frame by which a controller says that it has left the bus."""
    return Frame(BUS_OFF, bytes(8), error=True)
