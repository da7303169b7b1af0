# SPDX-License-Identifier: BSD-3-Clause
"""The plant's links: pinocchio's model of what hangs on the joints' springs, and its numbers as a table."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.plant.joints import joint_kind
from impedance_modules.plant.plant_state import LINK, RIGID, Table
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


def link_table(links: pin.Model, added_mass: Array | None = None) -> Table:
    """Tabulates the links, row 0 the world at rest and falling up; joint i moves row i + 1.

    Args:
        links: From ``link_model``.
        added_mass: (n, 6, 6) of water that each link takes along, in its joint's axes; None for none.
    """
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
        if added_mass is not None:
            row["water"] = added_mass[i - 1]
            row["wet"] = bool(added_mass[i - 1].any())
    return table


def water_inertia(links: pin.Model, table: Table, q: Array) -> Array:
    """Sums sum J_i^T W_i J_i of the water that the links take along, (n, n) [kg.m^2]; without gravity."""
    data, total = links.createData(), np.zeros((links.nv, links.nv))
    pin.computeJointJacobians(links, data, q)
    for i in np.flatnonzero(table["wet"]):
        J = pin.getJointJacobian(links, data, int(i), pin.ReferenceFrame.LOCAL)
        total += J.T @ table[i]["water"] @ J
    return total


def mobility_under_water(links: pin.Model, table: Table, data: pin.Data, q: Array) -> Array:
    """Computes (M + A)^-1 (n, n) of the links at q (n,), A of the water that they take along."""
    dry = np.array(pin.computeMinverse(links, data, q))
    if not table["wet"].any():
        return dry
    water = water_inertia(links, table, q)
    return np.asarray(np.linalg.solve(np.eye(q.size) + dry @ water, dry))
