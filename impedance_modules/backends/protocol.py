# SPDX-License-Identifier: BSD-3-Clause
"""What a robot must be able to do for a task to run on it: four methods and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from impedance_modules.robot.state import RobotState

Array = NDArray[np.float64]

Finish = Literal["hold", "release"]


@dataclass(frozen=True)
class FirstState:
    """How a robot stands when torque control begins.

    Attributes:
        state: Its first sample.
        acting: (n,) torque command that acts already [N.m]; zero unless the robot was handed over under load.
    """

    state: RobotState
    acting: Array


class Backend(Protocol):
    """A robot, simulated, recorded or real.

    The loop calls ``start`` once, then ``read`` and ``write`` in turn, then ``finish`` once, whatever
    happened in between.
    """

    def start(self) -> FirstState:
        """Connects, checks that the robot may be commanded, and returns how it stands.

        Raises:
            ImpedanceError: The robot is not there or must not be moved; nothing has moved.
        """

    def read(self) -> RobotState | None:
        """Waits for the next state; None when it did not come in time.

        Raises:
            EndOfRecording: There will be no more.
            RobotStopped: The robot, or what watches it, has ended torque control.
        """

    def write(self, effort: Array) -> None:
        """Sends one torque command (n,) [N.m], excluding what the robot adds by itself."""

    def finish(self, how: Finish) -> None:
        """Ends torque control: ``hold`` where the robot is, or ``release`` it; once more does nothing."""


@runtime_checkable
class RealRobot(Protocol):
    """A robot that goes on living while a run is prepared, and tells more than a state."""

    def newest(self) -> FirstState:
        """How it stands now, after ``start``; time is counted from here.

        Raises:
            ImpedanceError: It does not say any more.
        """

    def warm_up_with(self, cycle: Callable[[], None]) -> None:
        """Has the robot call ``cycle`` shortly before each state is due, where there is time for it."""

    def extra_columns(self) -> tuple[str, ...]:
        """Names what else is recorded of it; after ``start``, and always the same."""

    def extra_values(self) -> Array:
        """Newest value of each; NaN where there is none."""
