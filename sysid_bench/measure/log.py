"""what happens on a bus -> MCAP, as it happens: small chunks, flushed to the disk, description first.

Topics: /record (samples of the record), /outside (run-in and run-out), /command, /feedback, /state, /can (raw
frames, sent and received), /event. A killed writer loses at most the last chunk or second.
"""

from __future__ import annotations

import os
import queue
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

from sysid_bench.files.disk import json_text
from sysid_bench.frames.codec import Decoded
from sysid_bench.frames.frame import Frame
from sysid_bench.measure.commands import Commands
from sysid_bench.measure.finish import Scan
from sysid_bench.measure.samples import Sample
from sysid_bench.nouns import Array
from sysid_bench.records.mcap_write import ORIGIN, describe, register, sample_class
from sysid_bench.records.protobuf import message_class

CHUNK_BYTES = 64 * 1024
FLUSH_S = 1.0
TOPICS = {
    "/command": ("sysid_bench.Command", {"k": "uint64", "u": "repeated double"}),
    "/feedback": ("sysid_bench.Feedback", {"k": "uint64", "message": "string", "y": "repeated double"}),
    "/state": ("sysid_bench.State", {"state": "string", "fault": "string"}),
    "/can": (
        "sysid_bench.CanFrame",
        {"id": "uint32", "data": "bytes", "fd": "bool", "extended": "bool", "error": "bool", "sent": "bool"},
    ),
    "/event": ("sysid_bench.Event", {"text": "string"}),
    "/statistics": ("sysid_bench.Statistics", {"json": "string"}),
}
RECORD, OUTSIDE = "/record", "/outside"


class RunLog:
    """Sink of a session; `viewer` is shown every sample, too. Messages are packed and written by a thread of their own, so that a slow disk delays no frame."""

    def __init__(
        self,
        path: Path,
        rig: Any,
        plan: Commands,
        properties: Mapping[str, Any],
        origin: Mapping[str, Any],
        attachments: Mapping[str, bytes | str],
        viewer: Any = None,
    ) -> None:
        self._viewer = viewer
        self._plan, self._rig = plan, rig
        self._queue: queue.SimpleQueue = queue.SimpleQueue()
        self._file = open(path, "wb")
        self._writer = Writer(
            self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True
        )
        self._writer.start(profile="", library="sysid_bench")
        describe(self._writer, properties, origin, attachments)
        files = {name: data.encode() if isinstance(data, str) else data for name, data in attachments.items()}
        self.written = Scan({}, dict(properties), {**files, ORIGIN: json_text(origin).encode()})
        self._sample = sample_message(rig)
        self._messages = {topic: message_class(*spec) for topic, spec in TOPICS.items()}
        self._channels = {topic: register(self._writer, topic, m) for topic, m in self._messages.items()}
        for topic in (RECORD, OUTSIDE):
            self._channels[topic] = register(self._writer, topic, self._sample)
        self._sync()
        self.failure: Exception | None = None
        self.samples = 0
        self._thread = threading.Thread(target=self._work, name="log", daemon=True)
        self._thread.start()

    def sample(self, sample: Sample) -> None:
        self.samples += 1
        self._queue.put((time.time_ns(), None, sample))

    def command(self, k: int, u: Array) -> None:
        self._queue.put((time.time_ns(), "/command", {"k": k, "u": u}))

    def feedback(self, decoded: Decoded, k: int) -> None:
        channels = (*self._rig.output_channels, *self._rig.velocity_channels)
        y = [decoded.values[c.signal] * c.scale for c in channels if c.message == decoded.message]
        self._queue.put((int(decoded.time * 1e9), "/feedback", {"k": k, "message": decoded.message, "y": y}))

    def state(self, state: str, fault: str) -> None:
        self._queue.put((time.time_ns(), "/state", {"state": state, "fault": fault}))

    def frame(self, frame: Frame, sent: bool) -> None:
        self._queue.put((int(frame.time * 1e9) or time.time_ns(), "/can", (frame, sent)))

    def event(self, text: str) -> None:
        self._queue.put((time.time_ns(), "/event", {"text": text}))

    def statistics(self, text: str) -> None:
        self._queue.put((time.time_ns(), "/statistics", {"json": text}))

    def close(self) -> None:
        """Write what is queued, and the end of the file. Raises what stopped the writing, if anything did."""
        self._queue.put(None)
        self._thread.join()
        if self.failure is None:
            self._writer.finish()
            self._sync()
        self._file.close()
        if self._viewer:
            self._viewer.close()
        if self.failure is not None:
            raise self.failure

    def _work(self) -> None:
        flushed, size = time.monotonic(), self._file.tell()
        try:
            while (item := self._queue.get()) is not None:
                self._write(*item)
                if time.monotonic() - flushed > FLUSH_S:
                    self._writer.flush()
                    flushed = time.monotonic()
                if self._file.tell() != size:
                    self._sync()
                    size = self._file.tell()
        except Exception as problem:
            self.failure = problem

    def _write(self, stamp: int, topic: str | None, content: Any) -> None:
        if topic is None:
            topic, message = self._sampled(content)
        elif topic == "/can":
            frame, sent = content
            message = self._messages[topic](
                id=frame.id,
                data=frame.data,
                fd=frame.fd,
                extended=frame.extended,
                error=frame.error,
                sent=sent,
            )
        else:
            message = self._messages[topic](**content)
        self._writer.add_message(self._channels[topic], stamp, message.SerializeToString(), stamp)

    def _sampled(self, sample: Sample) -> tuple[str, Any]:
        """Topic and message of a sample; those of the record are kept for the judge, too."""
        if self._viewer:
            self._viewer.sample(sample)
        message = pack_sample(self._sample, sample, self._rig.rate_hz)
        if not self._plan.first <= sample.k < self._plan.first + self._plan.N:
            return OUTSIDE, message
        self.written.add(message)
        return RECORD, message

    def _sync(self) -> None:
        self._file.flush()
        os.fsync(self._file.fileno())


def sample_message(rig: Any) -> Any:
    """Message class of one sample: the columns of a record, and number, device tick, time of arrival."""
    u = [f"u{i + 1}" for i in range(len(rig.input_channels))]
    y = [f"y{i + 1}" for i in range(len(rig.output_channels))]
    return sample_class(["t", *u, *y, "quality"], {"k": "uint64", "tick": "int64", "host_s": "double"})


def pack_sample(message: Any, sample: Sample, rate_hz: float) -> Any:
    """t is the device's nominal time of sample k until the run is finished and the clocks are compared."""
    columns = {f"u{i + 1}": float(x) for i, x in enumerate(sample.u)}
    columns |= {f"y{i + 1}": float(x) for i, x in enumerate(sample.y)}
    return message(
        t=sample.k / rate_hz,
        quality=sample.quality,
        k=sample.k,
        tick=sample.tick,
        host_s=sample.host_s,
        **columns,
    )
