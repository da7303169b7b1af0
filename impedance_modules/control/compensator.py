# SPDX-License-Identifier: BSD-3-Clause
"""From what a patch says to what is compensated in every cycle: the module's record, and the weight that it needs."""

from __future__ import annotations

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.effects.compensate import PatchCompensation
from impedance_modules.effects.compensation_builder import CompensationNumbers
from impedance_modules.effects.joint_motion import regularisation_velocity
from impedance_modules.effects.rigid_model import sliding_joints
from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.compensation import Compensation
from impedance_modules.modules.equilibrium_velocity import equilibrium_velocity
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.weight_difference import WeightDifference

BEYOND = 0.2
"""A joint's potential goes on changing so far beyond its range: the joint's stop gives way by less [rad]."""


class Compensator:
    """What is compensated in a run; its record is one of the modules.

    Attributes:
        record: For the laws of a cycle.
        weight: Of the links beyond the description.
    """

    def __init__(
        self, model: RobotModel, numbers: CompensationNumbers, *, modules: TaskModules, period: float
    ) -> None:
        """Takes the robot as it is described, what is compensated, the task's modules and the control period [s].

        Arms that take no part in the task are left alone.
        """
        real = model if numbers.robot is None else RobotModel(numbers.robot)
        joints = np.concatenate([arm.limb.joints for arm in modules.arms])
        self.weight = WeightDifference(model, real, joints)
        self._carries = model.spec.gravity_compensation == "robot"
        self.record = _record(model, numbers, modules, period)

    def update(self, q: Array) -> None:
        """Takes the state's positions (n,) [rad]; call before the laws of a cycle."""
        self.weight.update(q)
        self.record.weight[:] = self.weight.effort
        self.record.weight_energy = self.weight.energy
        if self._carries:
            self.record.carried[:] = self.weight.carried

    def forget(self) -> None:
        """Forgets where the equilibria were: a run begins."""
        self.record.motion.known = False


def compensator_of(found: PatchCompensation, modules: TaskModules, period: float) -> Compensator:
    """Makes the compensation of a whole patch."""
    return Compensator(found.model, found.numbers, modules=modules, period=period)


def _record(
    model: RobotModel, numbers: CompensationNumbers, modules: TaskModules, period: float
) -> Compensation:
    n, springs = model.n, sum(len(arm.springs) for arm in modules.arms)
    part = np.zeros(n)
    part[np.concatenate([arm.limb.joints for arm in modules.arms])] = 1.0
    lower, upper = model.column("position_min") - BEYOND, model.column("position_max") + BEYOND
    return Compensation(
        active=True,
        motion=equilibrium_velocity(springs, n, period),
        lower=lower,
        upper=upper,
        offset=part * numbers.offset,
        stiffness=part * numbers.stiffness,
        top=part * _tops(numbers, lower, upper),
        ahead=part[:, None] * numbers.ahead,
        back=part[:, None] * numbers.back,
        fastest=model.column("velocity_max"),
        regularisation=regularisation_velocity(sliding_joints(model.pin_model)),
        per_load=part * numbers.per_load,
        inverse_gain=np.where(part > 0.0, 1.0 / numbers.gain, 1.0),
        weight=np.zeros(n),
        carried=np.zeros(n),
        held=np.zeros(n),
        friction=np.zeros(n),
        effort=np.zeros(n),
    )


def _tops(numbers: CompensationNumbers, lower: Array, upper: Array) -> Array:
    """Gives the largest a q + k q^2 / 2 within each joint's range (n,) [J]: at an end, since no k is negative."""
    found = np.zeros_like(lower)
    acts = (numbers.offset != 0.0) | (numbers.stiffness != 0.0)
    for j in np.flatnonzero(acts):
        a, k = numbers.offset[j], numbers.stiffness[j]
        found[j] = max((a + 0.5 * k * q) * q for q in (lower[j], upper[j]))
    return found
