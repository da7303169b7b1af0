# SPDX-License-Identifier: BSD-3-Clause
"""The interface between a control loop and a robot: four methods, and three more for a real robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

from impedance_modules.arrays import Array
from impedance_modules.robot.state import RobotState

Finish = Literal["hold", "release"]


@dataclass(frozen=True)
class FirstState:
    """State of a robot when torque control begins.

    Attributes:
        state: Its first sample.
        acting: (n,) torque command already in force [N.m]; zero unless the robot was handed over under load.
    """

    state: RobotState
    acting: Array


class Backend(Protocol):
    """A robot, simulated, recorded or real.

    The loop calls ``start`` once, then ``read`` and ``write`` in turn, then ``finish`` once, whatever
    happened in between.
    """

    def start(self) -> FirstState:
        """Connects, checks that the robot may be commanded, and returns its state.

        Raises:
            ImpedanceError: The robot cannot be reached or must not be moved; nothing has moved.
        """

    def read(self) -> RobotState | None:
        """Waits for the next state; None when it did not come in time.

        Raises:
            EndOfRecording: There is none left.
            RobotStopped: The robot, or its watchdog, has ended torque control.
        """

    def write(self, effort: Array) -> None:
        """Sends one torque command (n,) [N.m], excluding what the robot adds by itself (gravity)."""

    def finish(self, how: Finish) -> None:
        """Ends torque control: ``hold`` where the robot is, or ``release`` it; a second call does nothing."""


@runtime_checkable
class RealRobot(Protocol):
    """A robot in real time, which moves on while a run is prepared, and reports more than a state."""

    def newest(self) -> FirstState:
        """Its state now, after ``start``; time is counted from here.

        Raises:
            ImpedanceError: It reports no state any more.
        """

    def warm_up_with(self, cycle: Callable[[], None]) -> None:
        """Has the backend call ``cycle`` shortly before each state is due, where there is time for it."""

    def extra_columns(self) -> tuple[str, ...]:
        """Names the further columns that are recorded; after ``start``, and always the same."""

    def extra_values(self) -> Array:
        """Newest value of each; NaN where there is none."""
