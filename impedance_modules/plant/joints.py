# SPDX-License-Identifier: BSD-3-Clause
r"""Drives of all joints as one table, with the robot's stiff position hold and its joint stops.

elastic  I_r w' + D w = tau_m - tau_s,  tau_s = K (theta - q) + B (w - v)      (thesis eq. 3.2, 3.3)
         with play b: tau_s acts only beyond |theta - q| = b/2, from there on
rigid    the rotor moves with the link: tau_s = tau_m - D v - I_r v'
ideal    I_r = 0: tau_s = tau_m and theta = q + tau_m / K; motor damping does not act
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.plant.plant_state import ELASTIC, IDEAL, JOINT, RIGID, Table
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot import JointSpec

Array = NDArray[np.float64]

STOP_TIME = 5e-4
"""Damping of a joint stop over its stiffness [s]."""

STOP_STIFFENING = 10.0
"""Stiffness of a stop over that of the joint's spring."""

RIGID_DEFLECTION = 0.05
"""A joint without a spring is held and stopped as if full effort wound it this far [rad]."""


def joint_kind(joint: JointSpec) -> int:
    """Says which of the three drives a joint has."""
    if joint.reflected_inertia == 0.0:
        return IDEAL
    return RIGID if joint.spring_stiffness is None else ELASTIC


def joint_table(model: RobotModel) -> Table:
    """Tabulates the drives and limits of all joints; torques and hold are zero."""
    table = np.zeros(model.n, JOINT)
    for row, joint in zip(table, model.joints, strict=True):
        row["kind"] = joint_kind(joint)
        for name in ("spring_damping", "motor_damping", "reflected_inertia", "effort_max"):
            row[name] = getattr(joint, name)
        row["stiffness"] = 0.0 if joint.spring_stiffness is None else joint.spring_stiffness
        row["lower"], row["upper"] = joint.position_min, joint.position_max
        row["stop_stiffness"] = STOP_STIFFENING * structural_stiffness(joint)
        row["stop_damping"] = STOP_TIME * row["stop_stiffness"]
    return table


def structural_stiffness(joint: JointSpec) -> float:
    """Gives the joint's spring stiffness, or that of a rigid joint's assumed deflection [N.m/rad]."""
    if joint.spring_stiffness is not None:
        return joint.spring_stiffness
    return joint.effort_max / RIGID_DEFLECTION


def wound(joints: Table, ahead: Array) -> Array:
    """Gives how far each spring is wound (n,) [rad] when its motor is ahead of the link: what the play leaves."""
    gap = joints["half_gap"]
    return np.asarray(ahead - np.clip(ahead, -gap, gap))


def spring_torque(joints: Table, ahead: Array, speed: Array) -> Array:
    """Gives the torque through each elastic gear (n,) [N.m]; where there is play, teeth push and never pull."""
    turned = wound(joints, ahead)
    load = joints["stiffness"] * turned + joints["spring_damping"] * speed
    pushing = np.where(
        turned > 0.0, np.maximum(load, 0.0), np.where(turned < 0.0, np.minimum(load, 0.0), 0.0)
    )
    return np.where(joints["half_gap"] > 0.0, pushing, load)


def motor_position(joints: Table, position: Array, rotor: Array) -> Array:
    """Gives the true theta (n,) [rad]: the rotor's, or q + tau_m / K of an ideal torque source."""
    theta = rotor.copy()
    for i in np.flatnonzero((joints["kind"] == IDEAL) & (joints["stiffness"] > 0.0)):
        theta[i] = position[i] + joints["motor"][i] / joints["stiffness"][i]
    return theta


def hold_gains(model: RobotModel, mobility: Array) -> tuple[Array, Array]:
    """Gives the position hold's stiffness and damping, (n,) each, on the motor side.

    As stiff as the joint's own spring, critically damped for I_r + 1 / (M^-1)_ii.

    Args:
        model: The robot.
        mobility: (n, n) inverse mass matrix of the links at the pose to hold.
    """
    stiffness = np.array([structural_stiffness(joint) for joint in model.joints])
    inertia = model.reflected_inertia + 1.0 / np.diag(mobility)
    return stiffness, 2.0 * np.sqrt(stiffness * inertia)
