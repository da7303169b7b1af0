# SPDX-License-Identifier: BSD-3-Clause
"""Decides, while a task runs, whether what a hand rubs has become smooth."""

from __future__ import annotations

import numpy as np

from impedance_modules.control.hand_force import HandForce
from impedance_modules.control.roughness_windows import Directions, WindowFinder, way_of
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.task import SmoothCondition


class SmoothJudge:
    """Smooth is a surface over which the last windows, on average, stay below a bound, or below both.

    Attributes:
        found: Of every window so far, what is compared with the bound [N] or [1].
        frictions: Of every window so far, the coefficient of friction.
    """

    def __init__(self, condition: SmoothCondition, model: RobotModel, period: float) -> None:
        """Takes the condition, the robot, and the time between two looks [s]."""
        self._condition = condition
        self._force = HandForce(model, model.limbs[condition.target])
        ways = Directions(way_of(condition.along), way_of(condition.normal))
        self._finder = WindowFinder(ways, 1.0 / period)
        self.found: list[float] = []
        self.frictions: list[float] = []

    def met(self, state: RobotState) -> bool:
        """Takes the newest state into account; call once per look."""
        position, force = self._force.of(state.position, state.velocity, state.effort)
        window = self._finder.add(state.time, position, force)
        if window is None:
            return False
        self.found.append(window.band if self._condition.by == "spectrum" else window.friction)
        self.frictions.append(window.friction)
        if not self._stays_below(self.found, self._condition.below):
            return False
        also = self._condition.friction_below
        return also is None or self._stays_below(self.frictions, also)

    def _stays_below(self, found: list[float], bound: float) -> bool:
        """Says whether the last windows do, on average."""
        last = found[-self._condition.windows :]
        return len(last) == self._condition.windows and float(np.mean(last)) < bound
