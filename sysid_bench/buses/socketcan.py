"""SocketCAN of the Linux kernel: real controllers (can0) and the virtual one (vcan0)."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid_bench.frames.link import Link, enlarge_buffer
from sysid_bench.nouns import InputError


@dataclass(frozen=True)
class SocketCan:
    """channel: the interface, as `ip link` names it; it must be up, with the rig's bit-rate."""

    channel: str = "vcan0"

    @property
    def moves_hardware(self) -> bool:
        return not self.channel.startswith("vcan")

    def open(self, rig: Any) -> Link:
        """Raises InputError: no such interface, interface down, wrong bit-rate, no CAN in this kernel."""
        import can
        from can.interfaces.socketcan import SocketcanBus

        self._check(rig)
        try:
            bus = SocketcanBus(self.channel, fd=bool(rig.fd))
        except (can.CanError, OSError) as problem:
            raise InputError(
                f"bus socketcan: {self.channel} cannot be opened ({problem}). Is it up? `ip link set up {self.channel}`."
            ) from None
        enlarge_buffer(bus.socket)
        return Link(bus, f"socketcan {self.channel}", kernel_time=True)

    def _check(self, rig: Any) -> None:
        names = [name for _, name in socket.if_nameindex()]
        if self.channel not in names:
            raise InputError(
                f"bus.channel={self.channel}: no such interface; this machine has {', '.join(names)}. For a virtual "
                f"one: `ip link add dev {self.channel} type vcan && ip link set up {self.channel}`."
            )
        flags = int(Path(f"/sys/class/net/{self.channel}/flags").read_text(), 16)
        if not flags & 1:
            raise InputError(
                f"bus.channel={self.channel} is down; `ip link set up {self.channel} type can bitrate {rig.bitrate_bps:.0f}`."
            )
        found = _bitrate(self.channel)
        if found is not None and found != rig.bitrate_bps:
            raise InputError(
                f"wrong bit-rate: {self.channel} runs at {found} bit/s, rig {rig.name} wants {rig.bitrate_bps:.0f}. "
                f"`ip link set {self.channel} down && ip link set {self.channel} up type can bitrate {rig.bitrate_bps:.0f}`."
            )


def _bitrate(channel: str) -> int | None:
    """bit/s of the controller as `ip` tells; None for a virtual one."""
    if shutil.which("ip") is None:
        return None
    words = ["ip", "-details", "-json", "link", "show", channel]
    done = subprocess.run(words, capture_output=True, text=True, timeout=2, check=False)
    return bitrate_in(done.stdout)


def bitrate_in(text: str) -> int | None:
    """bit/s in the answer of `ip -details -json link show`; None where it gives none."""
    try:
        info = json.loads(text)[0].get("linkinfo", {}).get("info_data", {})
    except (ValueError, IndexError):
        return None
    return info.get("bittiming", {}).get("bitrate")
