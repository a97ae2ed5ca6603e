"""forces before a run, samples during it -> passed, or the reason why not."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from sysid_bench.measure.commands import Commands
from sysid_bench.nouns import Array, InputError

STEPS_OF_A_SPEED = 5


class Stopped(Exception):
    """A run must stop now: the reason, in one sentence."""


def check_forces(plan: Commands, rig: Any) -> None:
    """Raises InputError where a force or its rate is above the rig's limit; names the amplitude that would fit."""
    rate = np.diff(plan.u, axis=0, prepend=0 * plan.u[:1]) * rig.rate_hz
    for what, values, limit, knob in (
        ("the force", plan.u, rig.force_limit, "force_limit"),
        ("the rate of the force", rate, rig.force_rate_limit, "force_rate_limit"),
    ):
        refuse_above(what, values, limit, knob, rig.rate_hz)


def check_motion(q: Array, rig: Any) -> None:
    """Raises InputError where the predicted motion q (N, ny) is beyond the rig's limits."""
    refuse_above("the predicted position", q, rig.position_limit, "position_limit", rig.rate_hz)
    speed = np.diff(q, axis=0) * rig.rate_hz
    refuse_above("the predicted velocity", speed, rig.velocity_limit, "velocity_limit", rig.rate_hz)


def refuse_above(what: str, values: Array, limit: float, knob: str, rate_hz: float) -> None:
    k, channel = np.unravel_index(np.argmax(np.abs(values)), values.shape)
    peak = abs(values[k, channel])
    if not peak <= limit:
        raise InputError(
            f"{what} reaches {peak:.4g} on channel {channel + 1} at {k / rate_hz:.3g} s; rig.{knob} is {limit:g}. "
            f"amplitude={0.99 * limit / peak:.2g} times the present one would fit."
        )


class Watch:
    """Position, velocity and sensors while the rig moves."""

    def __init__(self, rig: Any, stuck_s: float | None) -> None:
        self._rig = rig
        self._recent = [deque(maxlen=STEPS_OF_A_SPEED + 1) for _ in rig.output_channels]
        self._same = [0] * len(rig.output_channels)
        self._moved = [False] * len(rig.output_channels)
        self._stuck = None if stuck_s is None else max(2, round(stuck_s * rig.rate_hz))

    def position(self, channel: int, k: int, y: float) -> None:
        """Take output `channel` of sample k. Raises Stopped."""
        recent = self._recent[channel]
        if not abs(y) <= self._rig.position_limit:
            raise Stopped(
                f"limit: output {channel + 1} is {y:.4g} at sample {k}; position_limit {self._rig.position_limit:g}"
            )
        if recent and y == recent[-1][1]:
            self._same[channel] += 1
        else:
            self._moved[channel] |= bool(recent)
            self._same[channel] = 0
        recent.append((k, y))
        if not self._rig.velocity_channels and self._rig.output == "displacement":
            self._speed(channel)
        if self._stuck is not None and self._moved[channel] and self._same[channel] >= self._stuck:
            raise Stopped(
                f"stuck sensor: output {channel + 1} has not changed by a bit for {self._same[channel]} samples (to sample {k})"
            )

    def _speed(self, channel: int) -> None:
        (k0, y0), (k1, y1) = self._recent[channel][0], self._recent[channel][-1]
        if k1 - k0 >= STEPS_OF_A_SPEED:
            self.velocity(channel, k1, (y1 - y0) / (k1 - k0) * self._rig.rate_hz)

    def velocity(self, channel: int, k: int, v: float) -> None:
        """Raises Stopped."""
        if not abs(v) <= self._rig.velocity_limit:
            raise Stopped(
                f"limit: velocity {channel + 1} is {v:.4g} at sample {k}; velocity_limit {self._rig.velocity_limit:g}"
            )
