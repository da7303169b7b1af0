# SPDX-License-Identifier: BSD-3-Clause
r"""The hinge of a held object, as the modules see it: where its axis is, how far it is turned, what acts about it.

Notation: a the unit vector of the axis, P the hinge's point, both fixed in the world W; E the hinge's frame at angle 0,
z along a; H the same frame fixed to the object, so that R_EH is a turn by the angle \phi about z. With the object's
origin O at r = p_O - P, a hinge rate \phi' gives the object the twist S \phi' at O, and a wrench w at O acts with
the torque S^T w about the axis:

    S = (a x r, a)        \phi = twist_angle(R_EH)

An impedance (\Lambda, B, K) at O is, about the axis, S^T \Lambda S, S^T B S and S^T K S - f . (a x (a x r)): as the
hinge turns, the lever of the net force f turns with it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.robot.pose import Pose, carry
from impedance_modules.robot.rotation import twist_angle
from impedance_modules.spec.hinge_spec import HingeSpec

LEAST_LEVER = 0.02
"""Least distance of a holding hand from the axis [m]; nearer, its frame would hold the axis itself."""


def axis_frame(axis: Array) -> Array:
    """Gives a rotation (3, 3) whose z is along ``axis`` (3,), of any length; x is the world axis most across it."""
    z = axis / np.linalg.norm(axis)
    across = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = across - (across @ z) * z
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def turned(angle: float) -> Array:
    """Gives the rotation (3, 3) about z by an angle [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Hinge:
    """An object's hinge, frozen at the start posture.

    Attributes:
        spec: What the task file says.
        frame: X_WE.
        on_object: X_OH.
    """

    spec: HingeSpec
    frame: Pose
    on_object: Pose

    @staticmethod
    def of_object(spec: HingeSpec, start: Pose) -> Hinge:
        """Makes the hinge of an object that starts at X_WO, turned by the declared angle."""
        frame = Pose(axis_frame(np.array(spec.axis, dtype=float)), np.array(spec.point, dtype=float))
        at_start = Pose(frame.rotation @ turned(spec.angle), frame.translation)
        return Hinge(spec, frame, start.inverse() @ at_start)

    @property
    def axis(self) -> Array:
        """Unit vector a (3,) in world axes."""
        return np.asarray(self.frame.rotation[:, 2])

    @property
    def point(self) -> Array:
        """P (3,) in world [m]."""
        return self.frame.translation

    def angle(self, pose: Pose) -> float:
        """Gives the hinge's angle [rad] where the object is at X_WO, between -pi and pi."""
        return float(twist_angle(self.frame.rotation.T @ (pose @ self.on_object).rotation))

    def object_pose(self, angle: float) -> Pose:
        """Gives X_WO at an angle [rad]: on the hinge's arc."""
        at_angle = Pose(self.frame.rotation @ turned(angle), self.frame.translation)
        return at_angle @ self.on_object.inverse()

    def motion(self, origin: Array) -> Array:
        """Gives S (6,), the object's twist at its origin (3,) [m] per unit rate of the hinge."""
        return np.concatenate([np.cross(self.axis, origin - self.point), self.axis])

    def torque(self, wrench: Array, origin: Array) -> float:
        """Gives the torque about the axis [N.m] of a wrench (6,) at the object's origin (3,) in world."""
        return float(self.motion(origin) @ wrench)

    def lever(self, point: Array) -> float:
        """Gives a point's distance from the axis [m]."""
        return float(np.linalg.norm(np.cross(self.axis, point - self.point)))

    def turning_load(self, force: Array, origin: Array) -> float:
        """Gives the stiffness about the axis [N.m/rad] by a net force (3,) [N] whose lever turns with the hinge."""
        arm = origin - self.point
        return -float(force @ np.cross(self.axis, np.cross(self.axis, arm)))

    def bearing(self, origin: Array) -> Array:
        """Gives what the bearing forbids, (5, 6): rows that the object's twist at its origin (3,) [m] must not have."""
        found = np.zeros((5, 6))
        found[:3] = carry(self.point - origin)[:3]
        found[3:, 3:] = self.frame.rotation[:, :2].T
        return found

    def rows(self, pose: Pose, jacobian: Array) -> tuple[Array, Array]:
        """Gives what the bearing holds, A (5, k), and by how much the object at X_WO has left it (5,) [m], [rad].

        Args:
            pose: X_WO.
            jacobian: (6, k) of the object's twist at its origin, world axes.
        """
        held = pose @ self.on_object
        tilt = self.frame.rotation[:, :2].T @ np.cross(self.axis, held.rotation[:, 2])
        return self.bearing(pose.translation) @ jacobian, np.concatenate(
            [held.translation - self.point, tilt]
        )
