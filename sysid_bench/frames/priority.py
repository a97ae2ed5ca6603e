"""A bus does not wait: ask the system to run this process before others."""

from __future__ import annotations

import os

NICE = -15


def prefer_this_process() -> bool:
    """True where the system allows it (root, or CAP_SYS_NICE); threads started later have it too."""
    try:
        os.setpriority(os.PRIO_PROCESS, 0, NICE)
    except (OSError, AttributeError):
        return False
    return True
