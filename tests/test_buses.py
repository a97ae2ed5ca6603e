"""Every bus carries every frame there and back, whole and in order."""

import os
import pty
import select
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from rig_bench import plant_named, rig_named, small_plan
from rig_processes import free_port

from sysid_bench.buses.serial_line import SerialLine
from sysid_bench.buses.udp import Udp
from sysid_bench.buses.virtual import Virtual
from sysid_bench.emulator.hardware import Hardware
from sysid_bench.emulator.process import Emulator
from sysid_bench.frames.frame import Frame, bus_off
from sysid_bench.frames.link import Link
from sysid_bench.measure.drive import drive
from sysid_bench.measure.limits import Watch
from sysid_bench.measure.log import RunLog
from sysid_bench.measure.session import Session
from sysid_bench.records import read_record

RIG, FD_RIG = rig_named("second_order"), rig_named("second_order_fd")


@contextmanager
def cable() -> Iterator[tuple[str, str]]:
    """Two serial ports joined by a thread that carries the bytes."""
    (left, left_port), (right, right_port) = pty.openpty(), pty.openpty()
    ended = threading.Event()

    def carry() -> None:
        while not ended.is_set():
            for end in select.select([left, right], [], [], 0.05)[0]:
                os.write(right if end == left else left, os.read(end, 4096))

    thread = threading.Thread(target=carry, daemon=True)
    thread.start()
    try:
        yield os.ttyname(left_port), os.ttyname(right_port)
    finally:
        ended.set()
        thread.join()


@contextmanager
def pair(kind: str) -> Iterator[tuple[Link, Link]]:
    with cable() as ports:
        port = free_port()
        buses: dict[str, Callable[[int], object]] = {
            "udp": lambda i: Udp(port=port),
            "virtual": lambda i: Virtual(channel=f"test {port}"),
            "serial": lambda i: SerialLine(ports[i]),
            "slcan": lambda i: SerialLine(ports[i], framing="slcan"),
        }
        links = [buses[kind](i).open(RIG if kind in ("serial", "slcan") else FD_RIG) for i in range(2)]
        try:
            yield links[0], links[1]
        finally:
            for link in links:
                link.close()


@pytest.mark.parametrize("kind", ["udp", "virtual", "serial", "slcan"])
def test_frames_travel_both_ways(kind: str) -> None:
    with pair(kind) as (host, device):
        host.own, device.own = frozenset({0x30}), frozenset({0x40})
        for number in range(100):
            host.send(Frame(0x30, bytes([number, 255, 0])))
            device.send(Frame(0x40, bytes([number])))
        for link, wanted, tail in ((device, 0x30, b"\xff\x00"), (host, 0x40, b"")):
            frames = [link.recv(2.0) for _ in range(100)]
            assert [(f.id, f.data) for f in frames] == [(wanted, bytes([n]) + tail) for n in range(100)]
            assert link.recv(0.05) is None  # its own are not among them


@pytest.mark.parametrize("kind", ["udp", "virtual"])
def test_long_frames_and_error_frames(kind: str) -> None:
    with pair(kind) as (host, device):
        host.own = frozenset({0x30})
        host.send(Frame(0x30, bytes(range(48)), fd=True))
        got = device.recv(2.0)
        assert (got.data, got.fd) == (bytes(range(48)), True)
        device.send(bus_off())
        got = host.recv(2.0)
        assert got.error and got.id & 0x40


def test_reception_is_stamped_by_the_wall_clock() -> None:
    import time

    with pair("udp") as (host, device):
        before = time.time()
        host.send(Frame(0x30, b"x"))
        assert before - 0.01 <= device.recv(2.0).time <= time.time() + 0.01


def test_two_buses_do_not_hear_each_other() -> None:
    with pair("udp") as (host, _), pair("udp") as (_, other):
        host.send(Frame(0x30, b"x"))
        assert other.recv(0.2) is None


def test_nothing_leaves_the_machine_by_default() -> None:
    import socket

    with pair("udp") as (host, _):
        sock = host._bus._multicast._socket
        assert sock.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0
        assert sock.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, 4) == socket.inet_aton("127.0.0.1")


class Both:
    """Device in a thread, host here, a link between them; `break_at` makes the host fail in mid-run."""

    def __init__(self, kind: str, folder: Path, pace: float = 1.0, break_at: int | None = None) -> None:
        rig = rig_named("second_order_1")
        with pair(kind) as (host, device):
            host.pace = device.pace = pace
            self.emulator = Emulator(rig, plant_named("one_dof"), Hardware(), [], device, None)
            done = threading.Event()
            thread = threading.Thread(target=self.emulator.run, args=(done.is_set,), daemon=True)
            thread.start()
            plan = small_plan(rig, 300)
            log = RunLog(folder / "run.mcap", rig, plan, {"hold": "zoh"}, {}, {})
            self.session = Session(rig, plan, Watch(rig, None), 2.0, log, host.name)
            if break_at is not None:
                self._break(break_at)
            self.reason = drive(self.session, host, log)
            done.set()
            thread.join()
            log.close()

    def _break(self, sample: int) -> None:
        step = self.session.step

        def failing(now: float) -> list[Frame]:
            if self.session.samples.newest >= sample:
                raise ZeroDivisionError("a bug in the host")
            return step(now)

        self.session.step = failing  # type: ignore[method-assign]


def test_a_whole_run_over_a_serial_line(tmp_path: Path) -> None:
    run = Both("slcan", tmp_path, pace=0.2)
    assert run.reason is None and run.session.done
    assert run.session.samples.counts["lost"] == run.session.samples.counts["corrupted"] == 0


def test_a_failing_host_stops_the_device_before_anything_else(tmp_path: Path) -> None:
    run = Both("virtual", tmp_path, break_at=100)
    assert (
        run.reason == "ZeroDivisionError: a bug in the host"
    )  # and no word of a stop that was not confirmed
    assert (run.emulator.device.state, run.emulator.device.fault) == ("fault", "emergency_stop")
    assert not run.emulator.device.force.any()
    record = read_record(tmp_path / "run.mcap")
    assert 80 < record.N < 300
