# SPDX-License-Identifier: BSD-3-Clause
"""Brings the arms to where a task begins, by the robot's own position mode, slowly, and only when asked to."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.baxter.robot_link import RobotLink
from impedance_modules.errors import RobotRefused
from impedance_modules.robot.model import Limb

Array = NDArray[np.float64]

NEAR = 0.1
"""Every joint this close to the start: the springs may pull it the rest of the way [rad]."""

ARRIVED = 0.03
"""Every joint this close: the robot's position mode has done what it can [rad]."""

TOP_SPEED = 0.25
"""Of the fastest joint on the way [rad/s]."""

SETTLING = 5.0
"""Longest wait at the end of the way; position mode lags by about 0.4 s [s]."""

STEP = 0.01
"""Between two targets [s]."""


class Approach:
    """One way to a start posture."""

    def __init__(self, limbs: Mapping[str, Limb], start: Array, allowed: bool) -> None:
        """Args are the limbs that move, the posture (n,) [rad], and whether moving there was asked for."""
        self._start, self._allowed = start, allowed
        self._joints = np.concatenate([limb.joints for limb in limbs.values()])
        self._names = [name for limb in limbs.values() for name in limb.joint_names]

    def go(self, link: RobotLink, move: Callable[[Array], None]) -> None:
        """Moves there if need be; returns when the arms have arrived.

        Args:
            link: Tells where the arms are.
            move: Sets the target (n,) [rad] of the position mode; raises when the robot may not move any more.

        Raises:
            RobotRefused: The arms are elsewhere and moving them was not asked for, or they do not arrive.
        """
        here = _position(link)
        if self._distance(here) <= NEAR:
            return
        if not self._allowed:
            raise RobotRefused(
                f"{self._furthest(here)} from where the task begins (valid: within {NEAR} rad;"
                f" --approach lets the robot's position mode bring the arms there at {TOP_SPEED} rad/s,"
                " with only the robot's own collision avoidance between them and things)"
            )
        self._travel(here, move)
        end = time.monotonic() + SETTLING
        while self._distance(_position(link)) > ARRIVED:
            if time.monotonic() > end:
                raise RobotRefused(
                    f"{self._furthest(_position(link))} from where the task begins, and position mode brings it"
                    " no closer: is something in its way?"
                )
            move(self._start)
            time.sleep(STEP)

    def _travel(self, here: Array, move: Callable[[Array], None]) -> None:
        """Minimum jerk: s = 10 t^3 - 15 t^4 + 6 t^5, whose top speed is 15/8 of the mean."""
        duration = max(1.0, 15.0 / 8.0 * self._distance(here) / TOP_SPEED)
        began = time.monotonic()
        while (t := (time.monotonic() - began) / duration) < 1.0:
            s = t**3 * (10.0 - 15.0 * t + 6.0 * t * t)
            move(here + s * (self._start - here))
            time.sleep(STEP)
        move(self._start)

    def _distance(self, position: Array) -> float:
        return float(np.abs(position - self._start)[self._joints].max())

    def _furthest(self, position: Array) -> str:
        away = (position - self._start)[self._joints]
        worst = int(np.argmax(np.abs(away)))
        return f"{self._names[worst]} is {away[worst]:+.3f} rad"


def _position(link: RobotLink) -> Array:
    """The newest measured angles (n,) [rad]."""
    if link.sample is None:
        raise RobotRefused("no state of the arms: is the robot on, and does 'impedance baxter check' pass?")
    return link.sample.state.position
