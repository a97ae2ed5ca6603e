"""A bus inside one process, for tests and trials."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sysid_bench.frames.link import Link


@dataclass(frozen=True)
class Virtual:
    """channel: a name; links that share it hear each other."""

    channel: str = "bench"

    moves_hardware = False

    def open(self, rig: Any) -> Link:
        import can

        protocol = can.CanProtocol.CAN_FD if rig.fd else can.CanProtocol.CAN_20
        bus = can.Bus(interface="virtual", channel=self.channel, protocol=protocol)
        return Link(bus, f"virtual {self.channel}", kernel_time=False)
