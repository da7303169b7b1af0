# SPDX-License-Identifier: BSD-3-Clause
"""Complete states of all joints out of JointState messages that each name some, timed by the robot's clock.

Several publishers, any order and extra joints are accepted. A step of the robot's clock is bridged by our own; how
late a sample is, is measured against the fastest recent delivery.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.backends.baxter.ros.messages import JointState
from impedance_modules.robot.state import RobotState

LEAP = 0.25
"""A stamp that advances this much more than our own clock is a step of the robot's clock [s]."""

DRIFT = 1e-4
"""Relative drift allowed between two free-running clocks [s/s]."""

NANO = 1e-9

MOST_JOINTS = 200
"""Joints of one message; one with more is no robot's, and is not kept."""


@dataclass(frozen=True)
class StateSample:
    """One complete state.

    Attributes:
        state: Of all joints of the model.
        number: Counts samples from 1.
        received: When it arrived, our monotonic clock [s].
        taken: When it must have been taken at the latest, by the same clock [s]: ``received`` less what it was late.
    """

    state: RobotState
    number: int
    received: float
    taken: float


class JointStateMerger:
    """Merges joint states by name.

    A sample is complete when every joint has been reported since the last one. So messages with gripper joints
    only never make a sample, and two messages with half the joints each make one.

    Attributes:
        malformed: Messages whose arrays are not as long as their list of names.
        seen: Names of all joints ever reported.
    """

    def __init__(self, joint_names: tuple[str, ...]) -> None:
        self.malformed = 0
        self.seen: set[str] = set()
        self.clock = RobotClock()
        self._names = joint_names
        n = len(joint_names)
        self._numbers: Array = np.zeros((3, n))
        self._reported = np.zeros(n, dtype=bool)
        self._number = 0
        self._places = lru_cache(maxsize=32)(self._find_places)

    @property
    def missing(self) -> tuple[str, ...]:
        """Joints of the model that no message has reported yet."""
        return tuple(name for name in self._names if name not in self.seen)

    def take(self, message: JointState, received: float) -> StateSample | None:
        """Takes a message; returns the sample that it completes, or None.

        Args:
            message: From any publisher.
            received: When it arrived [s].
        """
        count = len(message.name)
        lengths = {count, len(message.position), len(message.velocity), len(message.effort)}
        if len(lengths) > 1 or count > MOST_JOINTS:
            self.malformed += 1
            return None
        ours, theirs = self._places(message.name)
        if len(ours) == 0:
            return None
        numbers = np.array(message.position + message.velocity + message.effort)
        found = numbers.reshape(3, count).take(theirs, axis=1)
        if len(ours) < self._reported.size:
            self._numbers[:, ours] = found
            self._reported[ours] = True
            if not self._reported.all():
                return None
            found = self._numbers.copy()
        moment = self.clock.read(message.header.stamp, received)
        if moment is None:
            return None
        self._reported[:] = False
        self._number += 1
        found.flags.writeable = False
        state = RobotState(moment.time, *found)
        return StateSample(state, self._number, received, received - moment.lag)

    def _find_places(self, names: tuple[str, ...]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Returns where a message's joints belong in the model's vectors, and where they stand in it."""
        own = {name: index for index, name in enumerate(self._names)}
        self.seen |= own.keys() & set(names)
        # Of a joint that is named twice the last numbers count.
        pairs = sorted({own[name]: index for index, name in enumerate(names) if name in own}.items())
        return (
            np.array([pair[0] for pair in pairs], dtype=np.intp),
            np.array([pair[1] for pair in pairs], dtype=np.intp),
        )


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
    """Turns stamps into a time that never goes back.

    The stamps' differences count as long as they are plausible; when the robot's clock is set, back or far ahead,
    our own clock tells how much time has passed. How late a sample is, is measured against
    the fastest recent delivery: the offset of the two clocks is unknown, its changes are known.

    Attributes:
        steps: How often the robot's clock was set.
    """

    def __init__(self) -> None:
        self.steps = 0
        self._time = 0.0
        self._stamp: int | None = None
        self._received = 0.0
        self._late, self._fastest = 0.0, 0.0

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
            self._late, self._fastest = 0.0, 0.0
        else:
            # How much more time has passed here than there, since the first sample or the last step.
            self._late += waited - passed
        self._stamp, self._received = stamp, received
        self._time += passed
        self._fastest = min(self._fastest + DRIFT * max(waited, 0.0), self._late)
        return Moment(self._time, self._late - self._fastest)
