"""A bus does not wait: ask the system to run this process before others."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

REAL_TIME_PRIORITY = 1


@contextmanager
def before_others() -> Iterator[bool]:
    """Real-time scheduling (round robin) inside the block, threads started in it included; True where it is allowed.

    Linux allows it to root and to those with CAP_SYS_NICE or an rtprio limit.
    """
    if not hasattr(os, "sched_setscheduler"):
        yield False
        return
    before, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(REAL_TIME_PRIORITY))
    except OSError:
        yield False
        return
    try:
        yield True
    finally:
        os.sched_setscheduler(0, before, parameter)
