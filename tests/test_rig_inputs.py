"""What is wrong with a call is said in one message, in time, with exit code 2."""

import contextlib
import io
import os
import pty
import socket
import time
from pathlib import Path

import pytest
from rig_bench import Bench, plant_named, rig_named, small_plan
from rig_processes import free_port

from sysid_bench.__main__ import main
from sysid_bench.buses.serial_line import SerialLine
from sysid_bench.buses.socketcan import bitrate_in
from sysid_bench.buses.udp import Udp
from sysid_bench.files import write_model
from sysid_bench.nouns import InputError


@pytest.fixture(scope="module", autouse=True)
def everything_imported() -> None:
    """What the first call of a process takes depends on the machine and on what else it does."""
    with contextlib.redirect_stderr(io.StringIO()):
        assert main(["measure", "amplitude=40"]) == 2


def refused(*words: str) -> str:
    """The message of a call that ends with exit code 2 within 3 s and leaves no log."""
    out = Path(next((w[4:] for w in words if w.startswith("out=")), "none.mcap"))
    said = io.StringIO()
    start = time.process_time()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        code = main(["measure", *words])
    assert code == 2, said.getvalue()
    assert time.process_time() - start < 3.0
    assert not out.exists()
    message = said.getvalue()
    assert message.count("\n") == 1 and "Traceback" not in message
    return message


def test_a_rig_that_does_not_answer(tmp_path: Path) -> None:
    start = time.monotonic()
    message = refused(f"bus.port={free_port()}", "seconds=1", f"out={tmp_path / 'run.mcap'}")
    assert time.monotonic() - start < 60.0  # 1.2 s on the bus; the rest is a busy machine
    assert (
        "does not answer" in message and "no frame at all in 1.2 s" in message and "1000000 bit/s" in message
    )


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["bus=socketcan", "bus.channel=can7"], "no such interface"),
        (["bus.interface=eth77"], "no such interface"),
        (["bus.group=127.0.0.1"], "multicast"),
        (["bus=serial", "bus.port=/dev/ttyNONE"], "no such port"),
        (["rig.dbc=nowhere.dbc"], "no DBC file"),
        (["rig.bitrate_bps=123"], "bitrate_bps"),
        (["rig.rate_hz=1000"], "above the budget"),
        (["rig.outputs=[{message: FEEDBACK_1, signal: angle}]"], "wants signal 'angle'"),
        (["amplitude=40"], "force_limit"),
        (["rig.force_rate_limit=1"], "the rate of the force"),
        (["seconds=0"], "at least 2 samples"),
        (["out=run.csv"], ".mcap"),
        (["pace=0"], "pace"),
    ],
)
def test_wrong_calls(words: list[str], part: str, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)  # a preview's figure is written beside `out`
    assert part in refused(*words)


def test_a_port_that_another_program_holds() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("", 0))
        port = other.getsockname()[1]
        assert f"port {port} cannot be used" in refused(f"bus.port={port}")


def test_a_serial_port_that_another_program_holds() -> None:
    _, line = pty.openpty()
    bus, rig = SerialLine(os.ttyname(line)), rig_named("second_order")
    first = bus.open(rig)
    with pytest.raises(InputError, match="busy"):
        bus.open(rig)
    first.close()
    with pytest.raises(InputError, match="CAN FD"):
        bus.open(rig_named("second_order_fd"))


def test_a_wrong_bit_rate_is_read_off_the_interface() -> None:
    """As `ip -details -json link show can0` words it for a controller at 500 kbit/s, and for vcan0."""
    real = '[{"ifname":"can0","linkinfo":{"info_kind":"can","info_data":{"bittiming":{"bitrate":500000}}}}]'
    assert bitrate_in(real) == 500_000
    assert bitrate_in('[{"ifname":"vcan0","linkinfo":{"info_kind":"vcan"}}]') is None
    assert bitrate_in("") is None


def test_a_real_rig_is_not_moved_without_a_yes(monkeypatch) -> None:
    from sysid_bench.doors.measure import _confirm

    monkeypatch.setattr("sys.stdin", io.StringIO())
    with pytest.raises(InputError, match="yes=true"):
        _confirm(rig_named("second_order"), Udp(interface="eth0"), False)
    _confirm(rig_named("second_order"), Udp(interface="eth0"), True)
    _confirm(rig_named("second_order"), Udp(), False)


def test_frames_of_a_stranger_are_told_from_silence() -> None:
    from sysid_bench.frames.frame import Frame

    rig = rig_named("second_order")
    session = Bench(rig, plant_named("three_dof"), small_plan(rig, 10)).session
    session.step(0.0)
    for _ in range(5):
        session.receive(Frame(0x7FF, b"\0" * 8), 0.1)
    with pytest.raises(InputError, match="5 frames of other identifiers"):
        session.step(3.0)


def test_a_dry_run_shows_and_moves_nothing(tmp_path: Path) -> None:
    write_model(plant_named("three_dof").model(), tmp_path / "model.yaml")
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        code = main(
            [
                "measure",
                "dry_run=true",
                "seconds=5",
                f"model={tmp_path / 'model.yaml'}",
                f"out={tmp_path / 'run.mcap'}",
            ]
        )
    text = said.getvalue()
    assert code == 0 and not (tmp_path / "run.mcap").exists()
    for word in ("force", "bus load", "48.1 %", "predicted; limit 5", "watchdog"):
        assert word in text
    assert (tmp_path / "run.preview.png").stat().st_size > 5000


def test_a_predicted_motion_beyond_the_limit_is_refused(tmp_path: Path) -> None:
    write_model(plant_named("three_dof").model(), tmp_path / "model.yaml")
    message = refused("seconds=5", "rig.position_limit=0.05", f"model={tmp_path / 'model.yaml'}")
    assert "the predicted position" in message and "amplitude=" in message
