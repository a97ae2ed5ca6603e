"""session, bus, log -> a run done, or stopped: the emergency stop goes out before anything else."""

from __future__ import annotations

import signal
import traceback
from collections.abc import Iterator
from contextlib import contextmanager

from sysid_bench.frames.frame import Frame
from sysid_bench.frames.link import Link, LinkLost
from sysid_bench.measure.limits import Stopped
from sysid_bench.measure.log import RunLog
from sysid_bench.measure.session import Session
from sysid_bench.nouns import InputError

WAIT_S = 0.002
BURST = 500
STOP_FRAMES = 3
AFTER_STOP_S = 0.2


def drive(session: Session, link: Link, log: RunLog) -> str | None:
    """Run the session to its end; None, or the reason why it was stopped.

    Raises InputError where no rig answers (nothing has moved then). Any other way out sends the emergency stop.
    """
    link.own = session.rig.ids(host=True)
    with _interrupts() as asked:
        try:
            while not session.done:
                if asked:
                    raise KeyboardInterrupt
                _turn(session, link, log)
            return None
        except InputError:
            raise
        except BaseException as problem:
            confirmed = stop_now(session, link, log)
            for sample in session.samples.flush():
                log.sample(sample)
            reason = _reason(problem) + (
                "" if confirmed else "; the device did not confirm the emergency stop"
            )
            log.event(f"stopped: {reason}")
            if not isinstance(problem, (Stopped, LinkLost, KeyboardInterrupt)):
                log.event(traceback.format_exc())
            return reason


def _turn(session: Session, link: Link, log: RunLog) -> None:
    """Wait a little, take all frames that have come, then one step: few wake-ups, whatever the frame rate."""
    link.sleep(WAIT_S)
    for _ in range(BURST):
        frame = link.recv(0.0)
        if frame is None:
            break
        log.frame(frame, sent=False)
        session.receive(frame, link.now())
    if log.failure is not None:
        raise Stopped(f"the log cannot be written ({log.failure})")
    for out in session.step(link.now()):
        link.send(out)
        log.frame(out, sent=True)


def stop_now(session: Session, link: Link, log: RunLog) -> bool:
    """Emergency stop, three times; True where the device says within 0.2 s that it no longer runs."""
    frame = session.rig.emergency_stop_frame(session.codec)
    sent = sum(_try_to_send(link, frame) for _ in range(STOP_FRAMES))
    for _ in range(sent):
        log.frame(frame, sent=True)
    end = link.now() + AFTER_STOP_S
    while link.now() < end:
        try:
            answer = link.recv(0.01)
        except LinkLost:
            return False
        if answer is None:
            continue
        log.frame(answer, sent=False)
        decoded = session.codec.decode(answer)
        if decoded and decoded.intact and decoded.message == session.rig.state["message"]:
            if session.rig.state_of(decoded.values[session.rig.state["signal"]]) != "running":
                return True
    return False


def _try_to_send(link: Link, frame: Frame) -> bool:
    try:
        link.send(frame)
    except LinkLost:
        return False
    return True


def _reason(problem: BaseException) -> str:
    if isinstance(problem, KeyboardInterrupt):
        return "interrupted"
    return (
        str(problem) if isinstance(problem, (Stopped, LinkLost)) else f"{type(problem).__name__}: {problem}"
    )


@contextmanager
def _interrupts() -> Iterator[list[int]]:
    """Ctrl-C and SIGTERM, noted: raised where they fall, code that may not raise would swallow them."""
    asked: list[int] = []

    def note(number: int, frame: object) -> None:
        asked.append(number)

    try:
        before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:  # not the main thread: signals are somebody else's
        yield asked
        return
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
