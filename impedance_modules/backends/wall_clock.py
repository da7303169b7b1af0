# SPDX-License-Identifier: BSD-3-Clause
"""A simulated robot that runs no faster than the clock on the wall: for people and programs that take part."""

from __future__ import annotations

import time

from impedance_modules.arrays import Array
from impedance_modules.backends.grippers import GripperReport, GripperRobot
from impedance_modules.backends.protocol import Backend, Finish, FirstState
from impedance_modules.errors import NotConnected
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.gripper_spec import GripperMotion


class RealTime:
    """Another backend, whose states come when they would come from a robot, or later where it cannot keep up."""

    def __init__(self, backend: Backend) -> None:
        """Takes the backend, not yet started."""
        self._backend = backend
        self._began = 0.0

    def start(self) -> FirstState:
        """Starts it; time is counted from here."""
        first = self._backend.start()
        self._began = time.perf_counter() - first.state.time
        return first

    def read(self) -> RobotState | None:
        """Waits until the next state is due.

        Where the simulation has fallen behind, time is counted from there: it does not hurry to catch up.
        """
        state = self._backend.read()
        if state is not None:
            ahead = self._began + state.time - time.perf_counter()
            if ahead > 0.0:
                time.sleep(ahead)
            else:
                self._began -= ahead
        return state

    def write(self, effort: Array) -> None:
        """Passes a torque command (n,) on [N.m]."""
        self._backend.write(effort)

    def gripper_limbs(self) -> tuple[str, ...]:
        """Names the limbs whose grippers take orders."""
        return self._backend.gripper_limbs() if isinstance(self._backend, GripperRobot) else ()

    def order_gripper(self, limb: str, motion: GripperMotion) -> None:
        """Passes an order on."""
        self._with_grippers().order_gripper(limb, motion)

    def gripper_report(self, limb: str) -> GripperReport:
        """What is known of a gripper now."""
        return self._with_grippers().gripper_report(limb)

    def _with_grippers(self) -> GripperRobot:
        if not isinstance(self._backend, GripperRobot):
            raise NotConnected("this robot takes no orders for grippers")
        return self._backend

    def finish(self, how: Finish) -> None:
        """Ends it."""
        self._backend.finish(how)
