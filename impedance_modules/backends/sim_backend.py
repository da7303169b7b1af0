# SPDX-License-Identifier: BSD-3-Clause
"""The built-in plant as a backend: as fast as the machine allows, one control period per ``read``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.protocol import Finish, FirstState
from impedance_modules.errors import NotConnected, PlantNotFinite
from impedance_modules.plant.plant import Plant
from impedance_modules.robot.state import RobotState

Array = NDArray[np.float64]

SETTLING = 0.5
"""Time simulated in the robot's own mode after the torque ended [s]."""


class SimBackend:
    """A plant behind the four methods of ``Backend``.

    Attributes:
        plant: The simulated physics; for recordings and tests, never for the controller.
    """

    def __init__(self, plant: Plant, posture: Array, period: float) -> None:
        """Args are the plant, its start posture (n,) [rad] and the control period [s]."""
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
        return self.plant.sense()

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

    def _check(self) -> None:
        if not self._running:
            raise NotConnected("the simulated robot is not running: call start() first")
