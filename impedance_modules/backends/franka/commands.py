# SPDX-License-Identifier: BSD-3-Clause
r"""What one arm is sent in each of its cycles: a torque that never leaps, and a path that begins and ends at rest.

The robot stops itself where a torque changes by more than 1 N.m in a cycle of 1 ms. So what is sent follows what is
asked for:

    \tau_{k+1} = \tau_k + clip(\tau^* - \tau_k, -1, 1)      (N.m per cycle)

A torque that nobody renews is not sent on for ever: after ``silent`` it goes to zero, and torque mode ends.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

LARGEST_STEP = 0.999
"""Largest change of a torque in one cycle [N.m]; the robot's own limit is 1 N.m."""

RAMP_CYCLES = 200
"""Cycles in which the torque goes to zero at the end, unless that needs larger steps than ``LARGEST_STEP``."""

HALT_TIME = 0.3
"""Time in which a motion that is ended before its goal comes to rest [s]."""

TOP_SPEED = 0.25
"""Of the fastest joint on the way to a start pose [rad/s]."""

PEAK = 1.875
"""Top speed of a minimum-jerk motion over its mean speed."""


@dataclass(frozen=True)
class EndOfTorque:
    """Why the torque goes to zero; ``by_order`` is False where the arm's process decided so itself."""

    by_order: bool
    event: str
    detail: str


class TorqueCommand:
    """The torque of each cycle of one arm.

    Attributes:
        sent: Of the last cycle [N.m].
        ending: Why it goes to zero; None while it does not.
    """

    def __init__(self, largest: Sequence[float], silent: float, first: float, now: float) -> None:
        """Begins at zero torque.

        Args:
            largest: Of each joint [N.m].
            silent: Longest time without a new torque [s].
            first: Longest time until the first one [s].
            now: Monotonic time [s].
        """
        self.sent = [0.0] * len(largest)
        self.ending: EndOfTorque | None = None
        self._target = list(self.sent)
        self._largest = tuple(largest)
        self._silent, self._deadline, self._renewed = silent, now + first, now
        self._steps = list(self.sent)

    def order(self, torque: Sequence[float], now: float) -> None:
        """Sets the torque [N.m]; one that is not finite or too large ends torque mode and is never sent."""
        if self.ending is not None:
            return
        for joint, (value, most) in enumerate(zip(torque, self._largest, strict=True)):
            if not abs(value) <= most * (1.0 + 1e-9):
                detail = (
                    f"torque {value:.3f} N.m of joint {joint + 1} is not within its limit of {most:g} N.m"
                )
                self.end(EndOfTorque(False, "torque_refused", detail))
                return
        self._target = list(torque)
        self._renewed, self._deadline = now, now + self._silent

    def end(self, why: EndOfTorque) -> None:
        """Takes the torque to zero from now on; the first reason stays."""
        if self.ending is None:
            self.ending = why
            self._target = [0.0] * len(self.sent)
            self._steps = [abs(value) / RAMP_CYCLES for value in self.sent]

    def step(self, now: float) -> bool:
        """Computes ``sent`` of the next cycle; returns whether it is the last one, which is zero."""
        if self.ending is None and now > self._deadline:
            silence = 1e3 * (now - self._renewed)
            self.end(EndOfTorque(False, "controller_silent", f"no torque for {silence:.0f} ms"))
        if self.ending is None:
            for j, target in enumerate(self._target):
                change = target - self.sent[j]
                self.sent[j] += min(max(change, -LARGEST_STEP), LARGEST_STEP)
            return False
        for j, value in enumerate(self.sent):
            left = abs(value) - min(max(self._steps[j], 1e-3), LARGEST_STEP)
            self.sent[j] = math.copysign(left, value) if left > 0.0 else 0.0
        return not any(self.sent)


class PathCommand:
    """The position of each cycle on the way to a pose: minimum jerk from rest to rest, and a calm halt on the way.

    q(t) = q_0 + (10 s^3 - 15 s^4 + 6 s^5) (q_1 - q_0),      s = t / T
    """

    def __init__(self, start: Sequence[float], goal: Sequence[float]) -> None:
        """Begins at ``start``, the pose that the robot itself holds, towards ``goal`` [rad]."""
        self._start, self._goal = tuple(start), tuple(goal)
        farthest = max(abs(b - a) for a, b in zip(start, goal, strict=True))
        self._duration = max(PEAK * farthest / TOP_SPEED, 0.5)
        self._clock, self._rate, self._halting = 0.0, 1.0, False

    def halt(self) -> None:
        """Comes to rest on the path within ``HALT_TIME``."""
        self._halting = True

    @property
    def halted(self) -> bool:
        """Whether it came to rest before its goal."""
        return self._halting and self._clock < self._duration

    def step(self, elapsed: float) -> tuple[list[float], bool]:
        """Returns the next position [rad], and whether it is the last one.

        Args:
            elapsed: Time since the last cycle on the robot's clock [s].
        """
        if self._halting:
            self._rate = max(0.0, self._rate - elapsed / HALT_TIME)
        self._clock = min(self._clock + self._rate * elapsed, self._duration)
        s = self._clock / self._duration
        share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        position = [a + share * (b - a) for a, b in zip(self._start, self._goal, strict=True)]
        return position, self._rate == 0.0 or self._clock >= self._duration
