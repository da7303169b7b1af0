# SPDX-License-Identifier: BSD-3-Clause
r"""Distances between links, and how they change with the joints.

For a pair of links with closest points A and B and unit normal n from A to B (world axes):

    distance d [m],      d' = G v,      G = n^T (J_B - J_A)      (1, n) [m/rad]

A pair matters only where it closes faster than a damper towards its margin allows, c >= (d - margin) / T with
c = -d'. Closing speeds do not jump: none is taken to grow faster than ``QUICKEST``. So after every measurement it
is known for how long the pair cannot matter, and until then it is left alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.errors import BadInput
from impedance_modules.robot.kinematics import WORLD_AXES, Kinematics

Array = NDArray[np.float64]

QUICKEST = 20.0
"""Bound of the growth of a pair's closing speed [m/s^2]: a hand of Baxter's pushed by all its torque."""

LONGEST_WAIT = 0.1
"""A pair is looked at again after this time at the latest [s]."""


class Distances:
    """Signed distances of the robot's declared pairs of links.

    Attributes:
        pairs: (link, link) names.
        distance: (pairs,) last measured distance [m].
        gradient: (pairs, n) G; zero where the pair cannot matter in this cycle.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        pairs: Sequence[tuple[str, str]],
        margin: float,
        approach_time: float,
        period: float,
    ) -> None:
        """Args are the pairs, the distance they keep [m], the damper's T [s] and the control period [s]."""
        self.pairs = tuple(pairs)
        self._kinematics = kinematics
        self._margin, self._approach_time, self._period = margin, approach_time, period
        self._geometry = kinematics.model.geometry()
        self._shapes = [self._shape_pairs(first, second) for first, second in self.pairs]
        self._data = pin.GeometryData(self._geometry)
        self._wait = np.zeros(len(self.pairs), dtype=np.int64)
        self.distance: Array = np.full(len(self.pairs), np.inf)
        self.gradient: Array = np.zeros((len(self.pairs), kinematics.model.n))

    def update(self, v: Array) -> None:
        """Measures the pairs that may matter, at the last ``Kinematics.update`` and velocity v (n,) [rad/s]."""
        self._wait -= 1
        if not self.pairs or self._wait.min() > 0:
            return
        model, data = self._kinematics.model.pin_model, self._kinematics.pin_data
        pin.updateGeometryPlacements(model, data, self._geometry, self._data)
        for pair in np.flatnonzero(self._wait <= 0):
            self._measure(int(pair), v)

    def _measure(self, pair: int, v: Array) -> None:
        index, result = min(
            ((i, pin.computeDistance(self._geometry, self._data, i)) for i in self._shapes[pair]),
            key=lambda found: float(found[1].min_distance),
        )
        distance = float(result.min_distance)
        shapes = self._geometry.collisionPairs[index]
        normal = np.array(result.normal)
        row = self._point_row(shapes.second, np.array(result.getNearestPoint2()), normal)
        row -= self._point_row(shapes.first, np.array(result.getNearestPoint1()), normal)
        free = self._free_time(distance, -float(row @ v))
        self.distance[pair] = distance
        self.gradient[pair] = row if free < self._period else 0.0
        self._wait[pair] = max(1, int(free / self._period))

    def _free_time(self, distance: float, closing: float) -> float:
        """Bounds from below how long a pair cannot matter [s].

        The first t with c + a t >= (d - margin - c t - a t^2 / 2) / T, a = ``QUICKEST``; with c' = max(c, 0).
        """
        T, a, closing = self._approach_time, QUICKEST, max(closing, 0.0)
        room = distance - self._margin - closing * T
        if room <= 0.0:
            return 0.0
        slope = a * T + closing
        return min(LONGEST_WAIT, (np.sqrt(slope**2 + 2.0 * a * room) - slope) / a)

    def _point_row(self, shape: int, point: Array, normal: Array) -> Array:
        """Gives n^T J of a point fixed to the link that carries a shape, (n,)."""
        joint = self._geometry.geometryObjects[shape].parentJoint
        if joint == 0:
            return np.zeros(self._kinematics.model.n)
        model, data = self._kinematics.model.pin_model, self._kinematics.pin_data
        jacobian = pin.getJointJacobian(model, data, joint, WORLD_AXES)
        lever = np.cross(point - data.oMi[joint].translation, normal)
        return np.asarray(normal @ jacobian[:3] + lever @ jacobian[3:])

    def _shape_pairs(self, first: str, second: str) -> list[int]:
        """Registers every shape of one link against every shape of the other."""
        indices = []
        for a in self._shapes_of(first):
            for b in self._shapes_of(second):
                self._geometry.addCollisionPair(pin.CollisionPair(a, b))
                indices.append(len(self._geometry.collisionPairs) - 1)
        return indices

    def _shapes_of(self, link: str) -> list[int]:
        frame = self._kinematics.model.frame_id(link)
        found = [i for i, shape in enumerate(self._geometry.geometryObjects) if shape.parentFrame == frame]
        if not found:
            raise BadInput(f"link '{link}' has no collision shape, so its distance cannot be measured")
        return found
