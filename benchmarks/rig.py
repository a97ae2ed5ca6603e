"""What the hardware path costs: round trip, jitter, frames per second, CPU per sample, log throughput.

python benchmarks/rig.py [seconds]
"""

from __future__ import annotations

import multiprocessing
import os
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from sysid_bench import conf
from sysid_bench.build import build
from sysid_bench.buses.udp import Udp
from sysid_bench.frames.frame import Frame
from sysid_bench.frames.priority import before_others
from sysid_bench.measure.commands import Commands
from sysid_bench.measure.log import RunLog
from sysid_bench.measure.samples import Sample
from sysid_bench.records import read_record

PORT = 20000 + os.getpid() % 40000
TRIPS, FLOOD = 2000, 5000
ENV = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1]), "OMP_NUM_THREADS": "1"}


def rig_named(name: str):
    return build(conf.option("rig", name))


def echo(ready, port: int, frames: int) -> None:
    """The other end: sends every frame back."""
    link = Udp(port=port).open(None)
    link.own = frozenset({0x41})
    with before_others():
        ready.set()
        for _ in range(frames):
            frame = link.recv(5.0)
            if frame is not None:
                link.send(frame._replace(id=0x41))
    link.close()


def round_trips() -> None:
    """One frame there and back between two processes, one at a time."""
    ready = multiprocessing.Event()
    other = multiprocessing.Process(target=echo, args=(ready, PORT, TRIPS))
    other.start()
    ready.wait(20)
    link = Udp(port=PORT).open(None)
    link.own = frozenset({0x30})
    took = []
    with before_others():
        for _ in range(TRIPS):
            start = time.perf_counter()
            link.send(Frame(0x30, bytes(8)))
            if link.recv(1.0) is not None:
                took.append(1e6 * (time.perf_counter() - start))
    other.join()
    link.close()
    median, high = np.median(took), np.quantile(took, 0.99)
    print(
        f"round trip over udp, two processes: median {median:.0f} us, 99 % within {high:.0f} us, {TRIPS - len(took)} lost"
    )


def flood() -> None:
    """Frames in one go, read afterwards: what the kernel's buffer holds, and how fast they are read."""
    sender, receiver = Udp(port=PORT + 1).open(None), Udp(port=PORT + 1).open(None)
    receiver.own = frozenset()
    start = time.perf_counter()
    for number in range(FLOOD):
        sender.send(Frame(0x30, number.to_bytes(8, "little")))
    sent = time.perf_counter() - start
    start, got = time.perf_counter(), 0
    while receiver.recv(0.1) is not None:
        got += 1
    read = time.perf_counter() - start - 0.1
    print(
        f"frames: {FLOOD / sent:,.0f} sent per s; {got} of {FLOOD} unread ones kept and read at {got / read:,.0f} per s"
    )
    sender.close()
    receiver.close()


def run(seconds: float, label: str, device: list[str], both: list[str], folder: Path) -> None:
    """A whole run, device and host as processes: samples lost, jitter, CPU of each per sample."""
    bus = [f"bus.port={PORT + 2 + len(label)}", *both]
    words = [sys.executable, "-m", "sysid_bench"]
    emulator = subprocess.Popen(
        [*words, "emulate", *bus, *device], env=ENV, stdout=subprocess.PIPE, text=True
    )
    emulator.stdout.readline()
    idle = cpu(emulator.pid)
    start = time.monotonic()
    host = subprocess.Popen(
        [*words, "measure", *bus, f"seconds={seconds}", f"out={folder / 'run.mcap'}"],
        env=ENV, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    said = "".join(host.communicate())
    if host.returncode == 2:
        sys.exit(said)
    used = cpu(emulator.pid) - idle
    emulator.terminate()
    emulator.wait()
    record = read_record(folder / "run.mcap")
    frames, clock = record.origin["frames"], record.origin["clock"]
    jitter = f"{1e3 * clock['jitter_s']:.2f} ms rms, 99 % within {1e3 * clock['delay_p99_s']:.2f} ms"
    host_us = float(re.search(r"host CPU\s+(\d+)", said)[1]) if "host CPU" in said else float("nan")
    print(
        f"{label}: {record.N} samples, {frames['lost']} frames lost, {frames['forces_missed']} forces missed, arrival "
        f"jitter {jitter}; CPU per sample: device {1e6 * used / record.N:.0f} us, host {host_us:.0f} us "
        f"({time.monotonic() - start:.0f} s in all)"
    )


def cpu(pid: int) -> float:
    """s of CPU that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def log_throughput(samples: int = 20_000) -> None:
    """Eight channels as fast as the log takes them, against the 2 kHz that it must hold."""
    rig = replace(rig_named("second_order_8_fd"), rate_hz=2000)
    plan = Commands(np.zeros((samples, 8)), 0, samples, None)
    feedback = rig.codec().encode("FEEDBACK", {})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        log = RunLog(path, rig, plan, {"hold": "zoh"}, {}, {})
        y = np.random.default_rng(0).standard_normal((samples, 8))
        start = time.perf_counter()
        for k in range(samples):
            log.frame(feedback._replace(time=1e9 + k / 2000), sent=False)
            log.frame(feedback, sent=True)
            log.command(k, plan.u[k])
            log.sample(Sample(k, 500 * k, 1e9 + k / 2000, plan.u[k], y[k], 0))
        log.close()
        seconds = time.perf_counter() - start
        size = path.stat().st_size
        record = read_record(path)
    whole = record.N == samples and np.array_equal(record.y, y)
    print(
        f"log: {samples / seconds:,.0f} samples of 8 channels per s (4 messages each, {size / samples:.0f} bytes per sample, "
        f"fsync on every chunk), {'all there' if whole else 'SAMPLES MISSING'}"
    )


if __name__ == "__main__":
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    round_trips()
    flood()
    log_throughput()
    with tempfile.TemporaryDirectory() as scratch:
        run(seconds, "3 channels at 500 Hz, classic CAN", [], [], Path(scratch))
        fast = [
            "rig=second_order_8_fd",
            "rig.rate_hz=2000",
            "rig.data_bitrate_bps=8000000",
            "rig.lead_samples=400",
        ]
        run(seconds, "8 channels at 2 kHz, CAN FD", ["plant=eight_dof"], fast, Path(scratch))
