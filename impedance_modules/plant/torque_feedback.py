# SPDX-License-Identifier: BSD-3-Clause
r"""The joints' own torque loop on the plant: the motor gets what the spring's torque lacks of the commanded one.

    added = clip(k (u - K (\theta - q)), +-effort_max),   u = command + what the robot adds for the weight

The torque in the spring is sampled once per loop of the robot and may be some loops late; what is added stays until the
next loop. ``robot/inner_torque_loop.py`` has what this does to the rotor and up to which gain it is passive. In the
robot's own position mode the loop is off.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from impedance_modules.plant.joints import measurable_torques
from impedance_modules.plant.plant_state import PlantState
from impedance_modules.records import Vector
from impedance_modules.robot.inner_torque_loop import loop_delay
from impedance_modules.spec.robot_spec import InnerTorqueLoopSpec


class TorqueFeedback:
    """Feedback of the springs' torque to the motors of all joints."""

    def __init__(self, loop: InnerTorqueLoopSpec, state: PlantState) -> None:
        """Takes the loop as the robot file has it, and the state of the plant in which it runs."""
        self._loop, self._state = loop, state
        self._measured: deque[Vector] = deque()
        self._effort_max = np.array(state.joints["effort_max"])

    def reset(self, period: float) -> None:
        """Starts at rest: what was measured before is what is measured now.

        Args:
            period: Of the robot's loop [s].
        """
        now = self._measure()
        self._measured = deque(now for _ in range(loop_delay(self._loop, period)))

    def added(self, carried: Vector) -> Vector:
        """Measures, and computes what the motors get beside the command in this loop (n,) [N.m].

        Args:
            carried: (n,) what the robot adds for the weight [N.m].
        """
        joints = self._state.joints
        self._measured.append(self._measure())
        missing = joints["command"] + carried - self._measured.popleft()
        added = np.clip(self._loop.gain * missing, -self._effort_max, self._effort_max)
        return np.where((joints["hold_stiffness"] > 0.0) | (joints["hold_damping"] > 0.0), 0.0, added)

    def _measure(self) -> Vector:
        out = np.empty(self._effort_max.size)
        measurable_torques(self._state, out)
        return out
