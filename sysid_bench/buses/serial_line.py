"""A serial port: python-can's own framing, or an slcan adapter."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid_bench.frames.link import Link
from sysid_bench.nouns import InputError

SLCAN_BPS = (10_000, 20_000, 50_000, 83_333, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)


@dataclass(frozen=True)
class SerialLine:
    """port: the device file; framing: serial (python-can's) or slcan; baudrate_bps: of the serial line."""

    port: str
    framing: str = "serial"
    baudrate_bps: int = 115200

    moves_hardware = True

    def open(self, rig: Any) -> Link:
        """Raises InputError: no such port, port in use, framing or bit-rate that it cannot carry."""
        import can

        if self.framing not in ("serial", "slcan"):
            raise InputError(f"bus.framing must be serial or slcan; got {self.framing!r}.")
        if rig.fd:
            raise InputError(f"bus {self.framing} carries classic frames only; rig {rig.name} speaks CAN FD.")
        if not Path(self.port).exists():
            raise InputError(f"bus.port={self.port}: no such port.")
        options: dict[str, Any] = {"interface": "serial", "baudrate": self.baudrate_bps}
        if self.framing == "slcan":
            if rig.bitrate_bps not in SLCAN_BPS:
                raise InputError(f"wrong bit-rate: slcan has no {rig.bitrate_bps:.0f} bit/s.")
            options = {
                "interface": "slcan", "tty_baudrate": self.baudrate_bps, "bitrate": int(rig.bitrate_bps),
                "sleep_after_open": 0,
            }  # fmt: skip
        try:
            bus = can.Bus(channel=self.port, **options)
            _lock(bus, self.port)
        except (can.CanError, OSError, ValueError, ImportError) as problem:
            raise InputError(f"bus {self.framing}: {self.port} cannot be opened ({problem}).") from None
        return Link(bus, f"{self.framing} {self.port}", kernel_time=False)


def _lock(bus: Any, port: str) -> None:
    """Two programs on one port steal each other's bytes: take it for ourselves."""
    import fcntl

    line = getattr(bus, "_ser", None) or bus.serialPortOrig
    try:
        fcntl.flock(line.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        bus.shutdown()
        raise InputError(f"bus.port={port} is busy: another program has it open.") from None
