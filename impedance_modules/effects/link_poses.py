# SPDX-License-Identifier: BSD-3-Clause
r"""Where the links stand, for effects that act at a point of a link.

A force f at a point p loads joint i, with its axis S_i = (linear, angular) at the world's origin, by

    \tau_i = S_i . (f, p x f)       for every joint between the world and the link

and the point moves with \sum_i (S_i^v + S_i^w x p) q'_i over the same joints.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.records import Array3, Indices, Matrix, Record, Vector
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.rotation import dot, turn


class PlacedLinks(Record):
    """Poses of all links in world axes; row 0 is the world, joint i moves row i + 1.

    Attributes:
        parent: (n + 1,) row of each link's parent.
        rotation: (n + 1, 3, 3).
        translation: (n + 1, 3) of the links' joints [m].
        axis: (n + 1, 6) of the links' joints, linear then angular, at the world's origin.
    """

    parent: Indices
    rotation: Array3
    translation: Matrix
    axis: Matrix


@compiled
def point_of_link(links: PlacedLinks, body: int, offset: Vector, point: Vector) -> None:
    """Writes where a point (3,) of a link is [m], given in the link's joint's axes."""
    turn(links.rotation[body], offset, point)
    for k in range(3):
        point[k] += links.translation[body, k]


@compiled
def add_point_force(links: PlacedLinks, body: int, point: Vector, force: Vector, torque: Vector) -> None:
    """Adds J^T f of a force (3,) at a point (3,) of a link, world axes, to a torque on the joints (n,) [N.m]."""
    x = point[1] * force[2] - point[2] * force[1]
    y = point[2] * force[0] - point[0] * force[2]
    z = point[0] * force[1] - point[1] * force[0]
    i = body
    while i > 0:
        axis = links.axis[i]
        torque[i - 1] += dot(axis, force) + axis[3] * x + axis[4] * y + axis[5] * z
        i = links.parent[i]


@compiled
def point_velocity(links: PlacedLinks, body: int, point: Vector, velocity: Vector, out: Vector) -> None:
    """Writes the velocity (3,) of a point of a link [m/s], world axes, at joint velocities (n,)."""
    x, y, z = 0.0, 0.0, 0.0
    out[:] = 0.0
    i = body
    while i > 0:
        axis, speed = links.axis[i], velocity[i - 1]
        for k in range(3):
            out[k] += axis[k] * speed
        x, y, z = x + axis[3] * speed, y + axis[4] * speed, z + axis[5] * speed
        i = links.parent[i]
    out[0] += y * point[2] - z * point[1]
    out[1] += z * point[0] - x * point[2]
    out[2] += x * point[1] - y * point[0]


def empty_poses(n: int) -> PlacedLinks:
    """Makes the poses of n joints, all zero: for whoever has no effect that reads them."""
    return PlacedLinks(
        parent=np.zeros(n + 1, dtype=np.int64),
        rotation=np.zeros((n + 1, 3, 3)),
        translation=np.zeros((n + 1, 3)),
        axis=np.zeros((n + 1, 6)),
    )


def poses_at(model: RobotModel, position: Array) -> PlacedLinks:
    """Computes them at joint positions (n,) [rad]."""
    links, pinned, data = empty_poses(model.n), model.pin_model, model.pin_model.createData()
    pin.computeJointJacobians(pinned, data, position)
    for i in range(1, model.n + 1):
        links.parent[i] = pinned.parents[i]
        links.rotation[i], links.translation[i] = data.oMi[i].rotation, data.oMi[i].translation
    links.axis[1:] = data.J.T
    return links


def on_joint_axes(model: RobotModel, link: str, point: Array) -> tuple[int, Array, Array]:
    """Gives a link's row, a point (3,) of its frame in its joint's axes [m], and its frame's rotation there (3, 3)."""
    frame = model.pin_model.frames[model.frame_id(link)]
    placement = frame.placement
    return int(frame.parentJoint), placement.rotation @ point + placement.translation, placement.rotation
