# SPDX-License-Identifier: BSD-3-Clause
"""The plant's links: pinocchio's model of what hangs on the joints' springs, and its numbers as a table."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.plant.joints import joint_kind
from impedance_modules.plant.records import LINK, RIGID, Table
from impedance_modules.robot.model import RobotModel

Array = NDArray[np.float64]


def link_model(model: RobotModel, gravity: Array) -> pin.Model:
    """Builds the links alone: of the rotors only those fixed to their links, as armature.

    Args:
        model: The robot.
        gravity: (3,) acceleration in world axes [m/s^2].
    """
    links = pin.Model(model.pin_model)
    fixed = [joint_kind(joint) == RIGID for joint in model.joints]
    links.armature = np.where(fixed, model.reflected_inertia, 0.0)
    links.gravity.linear = gravity
    return links


def link_table(links: pin.Model) -> Table:
    """Tabulates the links, row 0 the world at rest and falling up; joint i moves row i + 1."""
    table = np.zeros(links.njoints, LINK)
    table["rotation"] = np.eye(3)
    table[0]["acceleration"][:3] = -links.gravity.linear
    data = links.createData()
    pin.computeJointJacobians(links, data, pin.neutral(links))
    for i in range(1, links.njoints):
        row, placement, body = table[i], links.jointPlacements[i], links.inertias[i]
        row["parent"], row["armature"] = links.parents[i], links.armature[i - 1]
        row["rest_rotation"], row["rest_translation"] = placement.rotation, placement.translation
        own_axes = pin.getJointJacobian(links, data, i, pin.ReferenceFrame.LOCAL)
        row["screw"] = own_axes.reshape(6, -1)[:, i - 1]
        row["mass"], row["centre"], row["inertia"] = body.mass, body.lever, body.inertia
    return table
