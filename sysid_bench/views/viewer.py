"""a .rrd file -> the rerun viewer: in a window, in a browser, or as a picture without a screen. Loopback only."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sysid_bench.nouns import InputError

LOOPBACK = "127.0.0.1"
START_S, LOAD_S, SETTLE_S = 20.0, 60.0, 1.5


def has_display() -> bool:
    """True where a window can be opened."""
    return sys.platform in ("darwin", "win32") or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )


def show(rrd: Path) -> int:
    """Open a window on the recording and wait until it is closed; the viewer's exit code."""
    return subprocess.run([str(program()), str(rrd), *_bind(), "--port", "auto"]).returncode


def serve(rrd: Path) -> int:
    """Serve the recording to browsers of this machine until interrupted; prints the address."""
    data, web = free_port(), free_port()
    address = f"http://{LOOPBACK}:{web}?url=rerun%2Bhttp%3A%2F%2F{LOOPBACK}%3A{data}%2Fproxy"
    print(f"{rrd.name}: open {address}  (Ctrl-C ends)", flush=True)
    ports = ["--port", str(data), "--web-viewer-port", str(web)]
    command = [str(program()), str(rrd), "--serve-web", *_bind(), *ports]
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ended by others, it ends the server too
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            return process.wait()
        except KeyboardInterrupt:
            process.terminate()
            return 0


def picture(rrd: Path, png: Path, size: str = "1920x1080") -> Path:
    """Write what the viewer shows of the recording as PNG, without a screen.

    Raises InputError where the graphics driver is missing or the viewer reports a problem.
    """
    with headless(size) as client:
        state = load(client, rrd)
        problems = [str(report) for view in state.views for report in view.reports]
        if problems:
            raise InputError(f"{rrd}: the viewer reports: {'; '.join(problems)}")
        png.write_bytes(client.take_screenshot())
    return png


def load(client: Any, rrd: Path) -> Any:
    """Open a recording and wait until its views are drawn; the viewer's state. Raises InputError after a minute."""
    client.open(str(rrd.resolve()))
    end = time.monotonic() + LOAD_S
    while time.monotonic() < end:
        state = client.get_state()
        if state.views and not state.loading:
            time.sleep(SETTLE_S)  # a few frames: plots appear after the views do
            return client.get_state()
        time.sleep(0.1)
    raise InputError(
        f"{rrd}: the viewer showed nothing within {LOAD_S:g} s; is it a rerun recording with a blueprint?"
    )


@contextmanager
def headless(size: str = "1920x1080") -> Iterator[Any]:
    """A rerun viewer without a screen, as a client. Raises InputError where no graphics driver is found."""
    from rerun.experimental import ViewerClient

    port = free_port()
    flags = ["--headless", "--hide-welcome-screen", "--window-size", size, "--port", str(port)]
    process = subprocess.Popen(
        [str(program()), *flags, *_bind()], stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    try:
        _wait_for(process, port)
        yield ViewerClient.connect(f"rerun+http://{LOOPBACK}:{port}/proxy")
    finally:
        process.kill()
        process.communicate()


def _wait_for(process: subprocess.Popen, port: int) -> None:
    end = time.monotonic() + START_S
    while time.monotonic() < end and process.poll() is None:
        with socket.socket() as probe:
            if probe.connect_ex((LOOPBACK, port)) == 0 and _stays(process):
                return
        time.sleep(0.1)
    process.kill()
    said = (process.communicate()[0] or b"").decode(errors="replace")
    if "graphics adapter" in said:
        raise InputError(
            "the rerun viewer finds no graphics driver; a software one is enough "
            "(Debian: apt-get install mesa-vulkan-drivers)."
        )
    raise InputError(f"the rerun viewer did not start: {said.strip()[-400:] or 'no answer'}")


def _stays(process: subprocess.Popen) -> bool:
    """The port opens before the graphics do: a viewer without a driver dies right after."""
    try:
        process.wait(timeout=0.7)
    except subprocess.TimeoutExpired:
        return True
    return False


def program() -> Path:
    """The viewer of the installed rerun-sdk. Raises InputError where it has none."""
    import rerun_cli

    path = Path(str(rerun_cli.__file__)).with_name("rerun.exe" if sys.platform == "win32" else "rerun")
    if not path.is_file():
        raise InputError(
            f"rerun's viewer is missing at {path}; install it anew: pip install --force-reinstall rerun-sdk."
        )
    return path


def _bind() -> list[str]:
    return ["--bind", LOOPBACK]


def free_port() -> int:
    """A port of this machine that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return probe.getsockname()[1]
