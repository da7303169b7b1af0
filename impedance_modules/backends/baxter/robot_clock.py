# SPDX-License-Identifier: BSD-3-Clause
"""The robot's clock, seen from here: steps are ignored, lateness is noticed."""

from __future__ import annotations

from dataclasses import dataclass

LEAP = 0.25
"""A stamp this much further ahead than our own clock went on is a step of the robot's clock [s]."""

DRIFT = 1e-4
"""Two free-running clocks may part by this much per second."""

NANO = 1e-9


@dataclass(frozen=True)
class Moment:
    """When a sample was taken.

    Attributes:
        time: Since the first sample, on the robot's clock, without its steps [s].
        lag: How much longer than usual it took to arrive [s].
    """

    time: float
    lag: float


class RobotClock:
    """Turns stamps into a time that only ever goes on.

    The stamps' differences count as long as they are plausible; when the robot's clock is set, back or far ahead,
    our own clock tells how much time has passed. How late a sample is, is judged by the quickest one of late:
    the difference of the two clocks is not known, its changes are.

    Attributes:
        steps: How often the robot's clock was set.
    """

    def __init__(self) -> None:
        self.steps = 0
        self._time = 0.0
        self._stamp: int | None = None
        self._received = 0.0
        self._late, self._quickest = 0.0, 0.0

    def read(self, stamp: int, received: float) -> Moment | None:
        """Takes a sample's stamp [ns, robot] and arrival [s, ours]; None for one that was seen before."""
        if self._stamp is None:
            self._stamp, self._received = stamp, received
            return Moment(0.0, 0.0)
        passed, waited = (stamp - self._stamp) * NANO, received - self._received
        if passed == 0.0:
            return None
        if passed < 0.0 or passed - waited > LEAP:
            self.steps += 1
            passed = max(waited, NANO)
            self._late, self._quickest = 0.0, 0.0
        else:
            # How much more time has gone by here than there, since the first sample or the last step.
            self._late += waited - passed
        self._stamp, self._received = stamp, received
        self._time += passed
        self._quickest = min(self._quickest + DRIFT * max(waited, 0.0), self._late)
        return Moment(self._time, self._late - self._quickest)
