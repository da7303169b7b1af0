# SPDX-License-Identifier: BSD-3-Clause
r"""What ends a phase, and what the hands feel, judged from measured effort alone.

The wrench of the surroundings on a hand is the least-squares solution of J^T w = \tau_ext over its limb's joints;
\tau_ext comes from ``robot.external_torque``. On a held object of mass m, slow motion, the environment puts

    F_env = \sum_i w_i + m g e_z         (w_i: the object on hand i)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.held_object import STANDARD_GRAVITY, HeldObject
from impedance_modules.robot.external_torque import ExternalTorque
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.task import ContactCondition

Array = NDArray[np.float64]

REGULARISATION = 1e-4
"""Added to J J^T [m^2, rad^2]: along a singular direction no wrench is claimed."""


class Touch:
    """Estimated wrench on every hand of the task.

    Attributes:
        wrench: (arms, 6) of the surroundings on each hand, world axes at the hand [N, N.m].
        period: Time between updates [s].
        state: The newest one.
    """

    state: RobotState

    def __init__(
        self, model: RobotModel, modules: TaskModules, kinematics: Kinematics, period: float
    ) -> None:
        self.period = period
        self._arms = modules.arms
        self._held = modules.held
        time_constant = max(model.spec.contact_detection.time, 2.0 * period)
        self._torque = ExternalTorque(model, time_constant, period)
        # Kinematics overwrites its arrays in place: a view of each hand's Jacobian is taken once.
        self._hands = [(kinematics.jacobian_of(arm.limb.hand), arm.limb.joints) for arm in modules.arms]
        self._gram, self._push = np.zeros((len(modules.arms), 6, 6)), np.zeros((len(modules.arms), 6))
        self._ridge = REGULARISATION * np.eye(6)
        self.wrench: Array = np.zeros((len(modules.arms), 6))

    def reset(self, state: RobotState) -> None:
        """Starts from a state taken as steady."""
        self.state = state
        self._torque.reset(state)
        self._solve()

    def update(self, state: RobotState) -> None:
        """Takes a state for which the kinematics are up to date."""
        self.state = state
        self._torque.update(state)
        self._solve()

    def _solve(self) -> None:
        """Solves the normal equations (J J^T + r I) w = J tau_ext of all hands at once."""
        for row, (J, joints) in enumerate(self._hands):
            arm = J[:, joints]
            np.matmul(arm, arm.T, out=self._gram[row])
            np.matmul(arm, self._torque.torque[joints], out=self._push[row])
        self._gram += self._ridge
        self.wrench[:] = np.linalg.solve(self._gram, self._push[:, :, None])[:, :, 0]

    def force_on(self, target: str | None) -> float:
        """Returns how hard the environment pushes on a target [N].

        Args:
            target: ``object``, an arm's name, or None: the object when one is held, else the arm that feels most.
        """
        names = [arm.limb.name for arm in self._arms]
        if target in names:
            return float(np.linalg.norm(self.wrench[names.index(target), :3]))
        if self._held is not None:
            return float(np.linalg.norm(self._force_on_object(self._held)))
        return max(float(np.linalg.norm(force)) for force in self.wrench[:, :3])

    def felt_by(self, limb: str) -> Array:
        """Returns the force of the surroundings on a hand, (3,) in world axes [N].

        A hand that holds the object feels the object's weight and squeeze too, which are no contact: it gets its equal
        share of what the surroundings put on the object.
        """
        held = self._held
        if held is not None and limb in held.limbs:
            return self._force_on_object(held) / len(held.limbs)
        row = [arm.limb.name for arm in self._arms].index(limb)
        return self.wrench[row, :3].copy()

    def _force_on_object(self, held: HeldObject) -> Array:
        names = [arm.limb.name for arm in self._arms]
        total: Array = self.wrench[[names.index(limb) for limb in held.limbs], :3].sum(axis=0)
        total[2] += held.spec.mass * STANDARD_GRAVITY
        return total


class ContactJudge:
    """Decides whether contact is there: a force over a threshold, or under it, for a time."""

    def __init__(self, condition: ContactCondition, touch: Touch, model: RobotModel) -> None:
        detection = model.spec.contact_detection
        self._condition = condition
        self._touch = touch
        self._force = detection.force if condition.force is None else condition.force
        self._time = detection.time if condition.time is None else condition.time
        self._held_for = 0.0

    def met(self) -> bool:
        """Takes the newest estimate into account; call once per update of the touch."""
        there = self._touch.force_on(self._condition.target) >= self._force
        self._held_for = self._held_for + self._touch.period if there == self._condition.present else 0.0
        return self._held_for >= self._time
