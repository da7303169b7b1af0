# SPDX-License-Identifier: BSD-3-Clause
"""A simulated robot as a backend: as fast as the machine allows, one control period per ``read``."""

from __future__ import annotations

from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.grippers import GripperReport
from impedance_modules.backends.protocol import Finish, FirstState
from impedance_modules.backends.sim_grippers import SimulatedGrippers
from impedance_modules.errors import NotConnected, PlantNotFinite
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.gripper_spec import GripperMotion

Array = NDArray[np.float64]

SETTLING = 0.5
"""Time simulated in the robot's own mode after the torque ended [s]."""


class SimulatedRobot(Protocol):
    """Physics and a robot's own side of it, in whole control periods; the built-in ``plant.plant.Plant`` is one."""

    @property
    def start_command(self) -> Array:
        """(n,) torque [N.m] that carries the start load; it acts before the first command."""

    def warm(self, q: Array) -> None:
        """Prepares what a first period would have to wait for, and stands reset at q (n,) [rad]."""

    def sense(self) -> RobotState:
        """Reports what the robot measures now."""

    def advance(self, command: Array | None) -> None:
        """Advances by one control period with a new torque command (n,) [N.m], or without one."""

    def hold(self) -> None:
        """Orders the robot's own position mode."""

    def release(self) -> None:
        """Orders zero torque."""


P = TypeVar("P", bound=SimulatedRobot)


class SimBackend(Generic[P]):
    """A simulated robot behind the four methods of ``Backend``.

    Attributes:
        plant: The simulated physics; for recordings and tests, never for the controller.
    """

    def __init__(
        self, plant: P, posture: Array, period: float, grippers: SimulatedGrippers | None = None
    ) -> None:
        """Args are the plant, its start posture (n,) [rad], the control period [s], and grippers if it has any."""
        self._grippers = grippers
        self.plant = plant
        self._posture = posture
        self._period = period
        self._command: Array | None = None
        self._running = False

    def start(self) -> FirstState:
        """Puts the robot at its start posture, everything at rest."""
        self.plant.warm(self._posture)
        self._running = True
        self._command = None
        return FirstState(self.plant.sense(), self.plant.start_command.copy())

    def read(self) -> RobotState | None:
        """Simulates one control period and reports the state at its end.

        Raises:
            PlantNotFinite: A number of the simulated state is not finite; there is no robot any more that could hold.
        """
        self._check()
        try:
            self.plant.advance(self._command)
        except PlantNotFinite:
            self._running = False
            raise
        self._command = None
        if self._grippers is not None:
            self._grippers.advance(self._period)
        return self.plant.sense()

    def gripper_limbs(self) -> tuple[str, ...]:
        """Names the limbs whose grippers take orders."""
        return () if self._grippers is None else self._grippers.limbs

    def order_gripper(self, limb: str, motion: GripperMotion) -> None:
        """Hands an order on; the fingers begin to move with the next ``read``."""
        self._with_grippers().order(limb, motion)

    def gripper_report(self, limb: str) -> GripperReport:
        """What is known of a gripper now."""
        return self._with_grippers().report(limb)

    def write(self, effort: Array) -> None:
        """Sets the torque command of the period that the next ``read`` simulates."""
        self._check()
        self._command = effort

    def finish(self, how: Finish) -> None:
        """Switches to the robot's own mode and lets it settle."""
        if not self._running:
            return
        self._running = False
        if how == "hold":
            self.plant.hold()
        else:
            self.plant.release()
        for _ in range(round(SETTLING / self._period)):
            self.plant.advance(None)

    def _with_grippers(self) -> SimulatedGrippers:
        if self._grippers is None:
            raise NotConnected("this simulated robot has no grippers")
        return self._grippers

    def _check(self) -> None:
        if not self._running:
            raise NotConnected("the simulated robot is not running: call start() first")
