"""frames per second -> share of the bus that they take, worst case."""

from __future__ import annotations

from dataclasses import dataclass

from sysid_bench.nouns import InputError


def classic_bits(size: int) -> int:
    """Bits of a classic frame with 11-bit identifier and `size` bytes, worst bit stuffing, with the gap after it.

    Davis, Burns, Bril, Lukkien: Controller Area Network (CAN) schedulability analysis, 2007, eq. (1).
    """
    return 8 * size + 44 + 3 + (34 + 8 * size - 1) // 4


def fd_bits(size: int) -> tuple[int, int]:
    """(bits at the nominal rate, bits at the data rate) of a CAN FD frame, worst case, 11-bit identifier.

    Bordoloi, Samii: The frame packing problem for CAN-FD, 2014, section III.
    """
    return 32, 28 + 5 * max(0, -((16 - size) // 64)) + 10 * size


@dataclass(frozen=True)
class Stream:
    """Frames of one kind: `count` of `size` bytes, `rate_hz` times a second."""

    name: str
    size: int
    rate_hz: float
    count: int = 1
    fd: bool = False

    def share(self, bitrate_bps: float, data_bitrate_bps: float) -> float:
        """Fraction of the bus's time."""
        if not self.fd:
            return self.count * self.rate_hz * classic_bits(self.size) / bitrate_bps
        slow, fast = fd_bits(self.size)
        return self.count * self.rate_hz * (slow / bitrate_bps + fast / data_bitrate_bps)

    def line(self, bitrate_bps: float, data_bitrate_bps: float) -> str:
        bits = f"{classic_bits(self.size)} bit"
        if self.fd:
            bits = "{} + {} bit".format(*fd_bits(self.size))
        share = 100 * self.share(bitrate_bps, data_bitrate_bps)
        return (
            f"{self.count} x {self.name} ({self.size} bytes, {bits}) at {self.rate_hz:g} Hz = {share:.1f} %"
        )


@dataclass(frozen=True)
class Load:
    """What a run would put on the bus: streams per sample (rate of the device) and others."""

    streams: tuple[Stream, ...]
    bitrate_bps: float
    data_bitrate_bps: float
    rate_hz: float

    @property
    def share(self) -> float:
        return sum(s.share(self.bitrate_bps, self.data_bitrate_bps) for s in self.streams)

    def arithmetic(self, between: str = "; ") -> str:
        lines = [s.line(self.bitrate_bps, self.data_bitrate_bps) for s in self.streams]
        speed = f"{self.bitrate_bps / 1e6:g} Mbit/s"
        if any(s.fd for s in self.streams):
            speed += f", data phase {self.data_bitrate_bps / 1e6:g} Mbit/s"
        return between.join([*lines, f"together {100 * self.share:.1f} % of {speed}"])

    def fitting_rate_hz(self, budget: float) -> float:
        """The highest sample rate within the budget, rounded down to two digits; 0 where none fits."""
        each = sum(
            s.share(self.bitrate_bps, self.data_bitrate_bps)
            for s in self.streams
            if s.rate_hz == self.rate_hz
        )
        rest = self.share - each
        rate = max(0.0, (budget - rest) / each * self.rate_hz)
        unit = 10.0 ** max(0, len(str(int(rate))) - 2)
        return rate // unit * unit

    def check(self, budget: float, fd_fits: str) -> None:
        """Raises InputError with the arithmetic and what would fit, above the budget (a fraction)."""
        if self.share > budget:
            rate = self.fitting_rate_hz(budget)
            slower = f"rig.rate_hz={rate:g} would fit" if rate > 0 else "no sample rate fits"
            raise InputError(
                f"the bus would be loaded to {100 * self.share:.1f} %, above the budget of {100 * budget:.0f} %: "
                f"{self.arithmetic()}. {slower}{fd_fits}."
            )
