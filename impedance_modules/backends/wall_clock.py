# SPDX-License-Identifier: BSD-3-Clause
"""A simulated robot that runs no faster than the clock on the wall: for people and programs that take part."""

from __future__ import annotations

import time

from impedance_modules.arrays import Array
from impedance_modules.backends.protocol import Backend, Finish, FirstState
from impedance_modules.robot.state import RobotState


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

    def finish(self, how: Finish) -> None:
        """Ends it."""
        self._backend.finish(how)
