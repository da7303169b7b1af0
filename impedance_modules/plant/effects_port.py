# SPDX-License-Identifier: BSD-3-Clause
"""The places where effects hook into the plant: torques at motor or link, and numbers of what it wears.

A torque is any object with the two methods of ``JointTorque``. The plant adds what it returns to the
motor's or the link's equation at every Runge-Kutta stage, and books its work under ``effects``. Everything
else that a patch changes comes as one ``PlantEffects``.
"""

from __future__ import annotations

from impedance_modules.effects.joint_motion import JointMotion, JointTorque
from impedance_modules.effects.plant_builder import PlantBuilder, PlantEffects
from impedance_modules.robot.model import RobotModel

__all__ = ["JointMotion", "JointTorque", "PlantEffects", "unworn"]


def unworn(model: RobotModel) -> PlantEffects:
    """Returns what a plant wears without a patch: nothing."""
    return PlantBuilder(model).finish()
