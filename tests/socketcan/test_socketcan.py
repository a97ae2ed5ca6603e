"""The rig over a real SocketCAN kernel (user-mode Linux), with candump as a witness that shares none of our code."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import cantools
import numpy as np
import pytest

from sysid_bench.frames.priority import before_others
from sysid_bench.records import read_record

HERE = Path(__file__).parent
REPOSITORY = HERE.parents[1]
NEEDED = {
    "linux.uml": "user-mode-linux", "candump": "can-utils", "insmod": "kmod", "ip": "iproute2",
}  # fmt: skip
PATH = os.environ["PATH"] + ":/sbin:/usr/sbin:/usr/local/sbin"
MISSING = sorted({package for tool, package in NEEDED.items() if shutil.which(tool, path=PATH) is None})
PACES = os.environ.get("SOCKETCAN_PACES", "0.1 0.04")  # of real time, the first that loses no frame
SECONDS = 20

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        bool(MISSING), reason=f"real SocketCAN is not tested: apt-get install {' '.join(MISSING)}"
    ),
]


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """Boot, run device and host for 20 s of device time, halt; the folder with what they wrote."""
    folder = tmp_path_factory.mktemp("socketcan")
    words = {
        "FOLDER": folder, "PYTHON": sys.executable, "REPOSITORY": REPOSITORY, "PACES": PACES,
        "SECONDS_OF_RUN": SECONDS, "BUS_OFF_AFTER": 8,
    }  # fmt: skip
    init = folder / "init.sh"
    lines = [f"{name}='{value}'; export {name}" for name, value in words.items()]
    init.write_text("#!/bin/sh\n" + "\n".join(lines) + "\n" + f". {HERE / 'guest.sh'}\n")
    init.chmod(0o755)
    kernel = [
        "linux.uml", "mem=768M", "rootfstype=hostfs", "root=/dev/root", "rootflags=/", "rw", f"init={init}",
        "con=null", "con0=fd:0,fd:1", "quiet",
    ]  # fmt: skip
    with open(folder / "console.log", "w") as console:
        with (
            before_others()
        ):  # each of the guest's system calls waits for its turn on the host: let it be short
            guest = subprocess.Popen(
                kernel, stdin=subprocess.DEVNULL, stdout=console, stderr=subprocess.STDOUT,
                env={**os.environ, "PATH": PATH}, start_new_session=True,
            )  # fmt: skip
        try:
            guest.wait(timeout=1500)
        finally:
            if guest.poll() is None:
                os.killpg(guest.pid, signal.SIGKILL)  # the guest's processes are the host's too
    assert (folder / "bus_off.rc").exists(), (folder / "console.log").read_text()[-3000:]
    return folder


def text(run: Path, name: str) -> str:
    return (run / name).read_text().strip()


def test_no_frame_is_lost_at_500_hz(run: Path) -> None:
    assert text(run, "measure.rc") == "0", text(run, "measure.out") + text(run, "emulate.out")
    record = read_record(run / "run.mcap")
    assert record.N == 500 * SECONDS and record.ny == 3
    counts = record.origin["frames"]
    assert counts["received"] >= 4 * record.N
    assert {counts[name] for name in ("lost", "forces_missed", "sync_lost", "corrupted", "duplicated")} == {0}


def candump(run: Path) -> list[tuple[int, bytes]]:
    """(identifier, payload) of every frame on the bus, as candump -L wrote them: (time) vcan0 ID#DATA."""
    found = []
    for line in text(run, "candump.log").splitlines():
        _, _, frame = line.split()
        name, _, data = frame.partition("#")
        found.append((int(name, 16), bytes.fromhex(data)))
    return found


def test_the_witness_saw_the_very_samples_of_the_record(run: Path) -> None:
    """FEEDBACK and FORCE frames in candump's log, decoded with the DBC by cantools, against the MCAP, bit for bit."""
    database = cantools.database.load_file(REPOSITORY / "conf/rig/second_order_3.dbc")
    columns: dict[str, list[tuple[int, float]]] = {}
    for number, data in candump(run):
        message = next((m for m in database.messages if m.frame_id == number), None)
        if message is not None and message.name.startswith(("FEEDBACK", "FORCE")):
            values = message.decode(data)
            signal = "position" if message.name.startswith("FEEDBACK") else "force"
            columns.setdefault(message.name, []).append((values["k"], values[signal]))
    record = read_record(run / "run.mcap")
    first = 250  # the run-in of 0.5 s
    for i in range(3):
        for letter, name, wraps in (("y", f"FEEDBACK_{i + 1}", 4096), ("u", f"FORCE_{i + 1}", 65536)):
            seen = columns[name][first : first + record.N]
            assert [k for k, _ in seen] == [(first + j) % wraps for j in range(record.N)]
            recorded = (record.y if letter == "y" else record.u)[:, i]
            assert np.array_equal(np.array([v for _, v in seen]).view(np.int64), recorded.view(np.int64))


def test_bus_off_ends_a_run(run: Path) -> None:
    assert text(run, "bus_off.rc") == "1" and "bus-off" in text(run, "bus_off.out"), text(run, "bus_off.out")


@pytest.mark.parametrize(("case", "words"), [("no_interface", "no such interface"), ("down", "is down")])
def test_a_bus_that_cannot_be_used_is_refused(run: Path, case: str, words: str) -> None:
    assert text(run, f"{case}.rc") == "2" and words in text(run, f"{case}.err")
