# SPDX-License-Identifier: BSD-3-Clause
r"""Torque that the surroundings put on the joints, judged from measured effort.

The links obey M(q) \ddot q + C(q, v) v + g(q) = \tau_s + \tau_ext with \tau_s the measured effort (thesis eq. 3.1), so

    \tau_ext = M(q) a + C(q, v) v + g(q) - \tau_s,     a = (v - v_f) / T,

both sides through the same first-order filter of time constant T: v_f and \tau_f follow v and \tau_s. M here
is the links' own inertia; the rotor sits on the other side of the sensor. g holds the torque that winds
parallel springs too.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from impedance_modules.arrays import Array
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.state import RobotState


class ExternalTorque:
    """Estimates the external joint torque from one state after another.

    Attributes:
        torque: (n,) last estimate [N.m].
    """

    def __init__(self, model: RobotModel, time_constant: float, period: float) -> None:
        """Args are the filter's time constant T and the time between states, both in s."""
        self._links = pin.Model(model.pin_model)
        self._links.armature = np.zeros(model.n)
        self._data = self._links.createData()
        self._parallel_spring_effort = model.parallel_spring_effort
        self._time_constant = time_constant
        self._blend = period / (time_constant + period)
        self._velocity = np.zeros(model.n)
        self._effort = np.zeros(model.n)
        self._acceleration = np.zeros(model.n)
        self.torque: Array = np.zeros(model.n)

    def reset(self, state: RobotState) -> None:
        """Starts from a state taken as steady."""
        self._velocity[:] = state.velocity
        self._effort[:] = state.effort
        self.update(state)

    def update(self, state: RobotState) -> Array:
        """Takes the next state and returns the estimate (n,) [N.m]."""
        self._velocity += self._blend * (state.velocity - self._velocity)
        self._effort += self._blend * (state.effort - self._effort)
        np.subtract(state.velocity, self._velocity, out=self._acceleration)
        self._acceleration /= self._time_constant
        model_torque = pin.rnea(self._links, self._data, state.position, state.velocity, self._acceleration)
        np.subtract(model_torque, self._effort, out=self.torque)
        self.torque += self._parallel_spring_effort(state.position)
        return self.torque
