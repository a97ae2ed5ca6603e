"""UDP multicast between processes: CAN frames without CAN hardware, on the loopback interface by default."""

from __future__ import annotations

import contextlib
import socket
import struct
from dataclasses import dataclass
from typing import Any

from sysid_bench.frames.link import Link, enlarge_buffer
from sysid_bench.nouns import InputError


@dataclass(frozen=True)
class Udp:
    """Frames as python-can's udp_multicast sends them.

    group, port   IPv4 multicast address and UDP port: one bus each
    interface     lo: nothing leaves this machine; another must be named deliberately
    """

    group: str = "239.74.163.2"
    port: int = 43113
    interface: str = "lo"

    @property
    def moves_hardware(self) -> bool:
        return self.interface != "lo"

    def open(self, rig: Any) -> Link:
        """Raises InputError: no such interface, no multicast address, port in use."""
        import can
        from can.interfaces.udp_multicast import UdpMulticastBus

        own = _address(self.interface)
        if not 224 <= int(self.group.split(".")[0]) <= 239:
            raise InputError(f"bus.group must be an IPv4 multicast address (224 to 239); got {self.group}.")
        self._check_port()
        try:
            bus = UdpMulticastBus(self.group, self.port, hop_limit=int(self.moves_hardware), fd=True)
        except (can.CanError, OSError) as problem:
            raise InputError(f"bus udp {self.group}:{self.port} cannot be opened: {problem}.") from None
        _bind_to_interface(bus._multicast._socket, self.group, own)
        return Link(bus, f"udp {self.group}:{self.port} on {self.interface}", kernel_time=True)

    def _check_port(self) -> None:
        """A port that another program holds for itself shows only when binding: ask before joining."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
            try:
                trial.bind(("", self.port))
            except (OSError, OverflowError) as problem:
                raise InputError(
                    f"bus udp: port {self.port} cannot be used ({getattr(problem, 'strerror', None) or problem}); another program holds it. "
                    "Choose another with bus.port=NUMBER on both sides."
                ) from None


def _bind_to_interface(sock: socket.socket, group: str, own: bytes) -> None:
    """python-can joins the group on the default interface: leave it, join on ours, send through ours."""
    member = socket.inet_aton(group)
    everywhere = member + struct.pack("@I", socket.INADDR_ANY)
    with contextlib.suppress(OSError):  # where there is no default interface, there is nothing to leave
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_DROP_MEMBERSHIP, everywhere)
    sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member + own)
    sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, own)
    enlarge_buffer(sock)


def _address(interface: str) -> bytes:
    """IPv4 address of an interface. Raises InputError, naming those there are."""
    import fcntl

    names = [name for _, name in socket.if_nameindex()]
    if interface not in names:
        raise InputError(
            f"bus.interface={interface}: no such interface; this machine has {', '.join(names)}."
        )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        try:
            answer = fcntl.ioctl(
                sock.fileno(), 0x8915, struct.pack("256s", interface.encode())
            )  # SIOCGIFADDR
        except OSError:
            raise InputError(f"bus.interface={interface} has no IPv4 address.") from None
    return answer[20:24]
