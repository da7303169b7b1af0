# SPDX-License-Identifier: BSD-3-Clause
"""The rigid object between the hands: where each hand holds it, and what it weighs.

Notation: O the object's origin, its centre, with axes along the world's at the start; H_i hand i.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impedance_modules.modules.squeeze import squeeze_forces
from impedance_modules.modules.weight import STANDARD_GRAVITY, share_wrench
from impedance_modules.robot.pose import Pose
from impedance_modules.spec.task import ObjectSpec

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HeldObject:
    """An object and its grasps, frozen at the start posture.

    Attributes:
        spec: What the task file says.
        start: X_WO at the start: its position, world axes.
        limbs: Names of the arms that hold it.
        hands: Their hand frames, in the same order.
        grasps: X_OH of each hand, the relative pose at the start.
        springs: Names of the springs that an ``object`` target moves: those whose frame is rigidly
            attached to a holding hand.
    """

    spec: ObjectSpec
    start: Pose
    limbs: tuple[str, ...]
    hands: tuple[str, ...]
    grasps: tuple[Pose, ...]
    springs: tuple[str, ...]

    @cached_property
    def squeeze(self) -> Array:
        """(h, 6) wrench of each hand's squeeze on the object; rigid grasps fix it in the object's axes."""
        offsets = np.array([grasp.translation for grasp in self.grasps])
        forces = squeeze_forces(offsets, self.spec.squeeze)
        return np.hstack([forces, np.zeros_like(forces)])

    def weight(self, rotation: Array) -> Array:
        """Shares the object's weight over the hands, (h, 6) in world axes, with the object turned by R_WO (3, 3)."""
        local = (self._carrying @ rotation[2]).reshape(-1, 3)
        return np.asarray((local @ rotation.T).reshape(-1, 6))

    @cached_property
    def _carrying(self) -> Array:
        """(h, 6, 3) wrench of each hand, in the object's axes, per component of the upward direction in them."""
        offsets = np.array([grasp.translation for grasp in self.grasps])
        lift = self.spec.mass * STANDARD_GRAVITY
        return np.stack([share_wrench(offsets, lift * up) for up in np.eye(6)[:3]], axis=2)

    def pose_from(self, hand_poses: tuple[Pose, ...]) -> Pose:
        """Locates the object from its hands: the first hand's axes, the mean of the origins.

        With rigid grasps every hand gives the same X_WO = X_WH X_OH^-1.
        """
        found = [hand @ grasp.inverse() for hand, grasp in zip(hand_poses, self.grasps, strict=True)]
        return Pose(found[0].rotation, np.mean([pose.translation for pose in found], axis=0))

    def inertia(self, rotation: Array) -> Array:
        """Computes the object's own inertia diag(m I, R I_O R^T), (6, 6) at O in world axes.

        Args:
            rotation: (3, 3) R_WO.
        """
        found = np.zeros((6, 6))
        found[:3, :3] = self.spec.mass * np.eye(3)
        moments = moments_of_inertia(self.spec.shape, self.spec.mass, self.spec.size)
        found[3:, 3:] = rotation @ np.diag(moments) @ rotation.T
        return found


def moments_of_inertia(shape: str, mass: float, size: tuple[float, ...]) -> Array:
    """Computes the principal moments (3,) [kg.m^2] of a uniform solid about its centre.

    box (a, b, c): m (b^2 + c^2) / 12 and so on; cylinder (diameter d, length l along z):
    m (3 (d/2)^2 + l^2) / 12 twice, m (d/2)^2 / 2; sphere (diameter d): 2/5 m (d/2)^2.
    """
    if shape == "box":
        a, b, c = (edge**2 for edge in size)
        return mass / 12.0 * np.array([b + c, a + c, a + b])
    radius = 0.5 * size[0]
    if shape == "cylinder":
        across = mass * (3.0 * radius**2 + size[1] ** 2) / 12.0
        return np.array([across, across, 0.5 * mass * radius**2])
    return np.full(3, 0.4 * mass * radius**2)


def distance_to_surface(shape: str, size: tuple[float, ...], point: Array) -> float:
    """Measures how far a point is from a solid's surface [m]; negative inside.

    Args:
        shape: ``box``, ``cylinder`` (along z) or ``sphere``.
        size: As in ``ObjectSpec``.
        point: (3,) in the solid's axes, from its centre [m].
    """
    if shape == "sphere":
        return float(np.linalg.norm(point)) - 0.5 * size[0]
    if shape == "box":
        excess = np.abs(point) - 0.5 * np.asarray(size)
    else:
        excess = np.array([np.hypot(point[0], point[1]) - 0.5 * size[0], abs(point[2]) - 0.5 * size[1]])
    outside = float(np.linalg.norm(np.maximum(excess, 0.0)))
    return outside + min(float(np.max(excess)), 0.0)
