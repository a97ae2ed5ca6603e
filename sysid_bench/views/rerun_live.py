"""samples of a run as they come -> rerun, in a window where there is a display, else in a browser of this machine."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from sysid_bench.views.rerun_record import _rgb, panels
from sysid_bench.views.style import COLOURS
from sysid_bench.views.viewer import LOOPBACK, free_port, has_display, program

BATCH = 25
SECONDS_IN_SIGHT = 10.0


class LiveView:
    """Forces and outputs of a running rig, the last ten seconds in sight. Called from the log's thread.

    path: write a recording instead of showing it.
    """

    def __init__(self, rig: Any, path: Path | None = None) -> None:
        import rerun as rr

        self._rig, self._waiting, self._process = rig, [], None
        self._stream = rr.RecordingStream("sysid_bench_rig")
        blueprint = _blueprint()
        if path is not None:
            self._stream.save(path, default_blueprint=blueprint)
        else:
            self._stream.connect_grpc(self._viewer(), default_blueprint=blueprint)
        for group, channels in (("y", rig.output_channels), ("u", rig.input_channels)):
            for i, channel in enumerate(channels):
                colour = _rgb(COLOURS[i % len(COLOURS)])
                lines = rr.SeriesLines(colors=[colour], names=[f"{group}{i + 1} ({channel.unit})"])
                self._stream.log(f"{group}/{i + 1}", lines, static=True)

    def _viewer(self) -> str:
        """Start the viewer; the address for the stream."""
        port, web = free_port(), free_port()
        words = [str(program()), "--bind", LOOPBACK, "--port", str(port)]
        if not has_display():
            words += ["--serve-web", "--web-viewer-port", str(web)]
            address = f"http://{LOOPBACK}:{web}?url=rerun%2Bhttp%3A%2F%2F{LOOPBACK}%3A{port}%2Fproxy"
            print(f"live        open {address}", flush=True)
        self._process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return f"rerun+http://{LOOPBACK}:{port}/proxy"

    def sample(self, sample: Any) -> None:
        """Take one sample; 25 at a time are sent."""
        self._waiting.append(sample)
        if len(self._waiting) >= BATCH:
            self._send()

    def _send(self) -> None:
        import rerun as rr

        samples, self._waiting = self._waiting, []
        index = rr.TimeColumn("t", duration=np.array([s.k for s in samples]) / self._rig.rate_hz)
        for group in ("y", "u"):
            values = np.array([getattr(s, group) for s in samples])
            for i in range(values.shape[1]):
                columns = rr.Scalars.columns(scalars=values[:, i])
                self._stream.send_columns(f"{group}/{i + 1}", indexes=[index], columns=columns)

    def close(self) -> None:
        """Send what is left; a window stays open, a server for browsers ends."""
        if self._waiting:
            self._send()
        self._stream.flush()
        self._stream.disconnect()
        if self._process is not None and not has_display():
            self._process.terminate()
            self._process.wait()


def _blueprint() -> Any:
    import rerun as rr
    import rerun.blueprint as rrb

    start = rr.TimeRangeBoundary.cursor_relative(seconds=-SECONDS_IN_SIGHT)
    sight = rr.VisibleTimeRange("t", start=start, end=rr.TimeRangeBoundary.cursor_relative())
    plots = [rrb.TimeSeriesView(origin=group, name=group, time_ranges=[sight]) for group in ("y", "u")]
    _, *folded = panels("t")
    time = rrb.TimePanel(timeline="t", state="collapsed", play_state="following")
    return rrb.Blueprint(rrb.Vertical(*plots, row_shares=[2, 1]), time, *folded)
