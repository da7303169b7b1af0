# SPDX-License-Identifier: BSD-3-Clause
r"""Distances between links, and how they change with the joints.

For a pair of links with closest points A and B and unit normal n from A to B (world axes):

    distance d [m],      d' = G v,      G = n^T (J_B - J_A)      (1, n) [m/rad]

A pair that is far apart cannot come close at once: with every joint below its declared speed bound the
distance shrinks at most at a known rate, so the pair is measured again only when it could have reached
``influence``. Nothing is lost by waiting, and ten pairs cost less than one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.errors import BadInput
from impedance_modules.robot.kinematics import WORLD_AXES, Kinematics

Array = NDArray[np.float64]


class Distances:
    """Signed distances of the robot's declared pairs of links.

    Attributes:
        pairs: (link, link) names.
        distance: (pairs,) last measured distance [m]; at least ``influence`` when not measured this cycle.
        gradient: (pairs, n) G; zero where the distance is above ``influence``.
    """

    def __init__(
        self, kinematics: Kinematics, pairs: Sequence[tuple[str, str]], influence: float, period: float
    ) -> None:
        self.pairs = tuple(pairs)
        self.influence = influence
        self._kinematics = kinematics
        self._period = period
        self._geometry = kinematics.model.geometry()
        self._shapes = [self._shape_pairs(first, second) for first, second in self.pairs]
        self._data = pin.GeometryData(self._geometry)
        self._closing = np.array([self._closing_bound(first, second) for first, second in self.pairs])
        self._wait = np.zeros(len(self.pairs), dtype=np.int64)
        n = kinematics.model.n
        self.distance: Array = np.full(len(self.pairs), np.inf)
        self.gradient: Array = np.zeros((len(self.pairs), n))

    def update(self) -> None:
        """Measures the pairs that may be close, at the state of the last ``Kinematics.update``."""
        self._wait -= 1
        due = np.flatnonzero(self._wait <= 0)
        if due.size == 0:
            return
        model, data = self._kinematics.model.pin_model, self._kinematics.pin_data
        pin.updateGeometryPlacements(model, data, self._geometry, self._data)
        for pair in due:
            self._measure(int(pair))

    def _measure(self, pair: int) -> None:
        index, result = min(
            ((i, pin.computeDistance(self._geometry, self._data, i)) for i in self._shapes[pair]),
            key=lambda found: float(found[1].min_distance),
        )
        distance = float(result.min_distance)
        self.distance[pair] = distance
        if distance > self.influence:
            self.gradient[pair] = 0.0
            free = (distance - self.influence) / (self._closing[pair] * self._period)
            self._wait[pair] = max(1, int(free))
            return
        self._wait[pair] = 1
        shapes = self._geometry.collisionPairs[index]
        normal = np.array(result.normal)
        row = self._point_row(shapes.second, np.array(result.getNearestPoint2()), normal)
        row -= self._point_row(shapes.first, np.array(result.getNearestPoint1()), normal)
        self.gradient[pair] = row

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

    def _closing_bound(self, first: str, second: str) -> float:
        """Bounds the speed at which two links can approach [m/s]: sum of v_max times reach."""
        model = self._kinematics.model
        speeds = model.column("velocity_max")
        return max(
            sum(
                float(speeds[joint]) * reach
                for link in (first, second)
                for joint, reach in self._reach(link).items()
            ),
            1e-3,
        )

    def _reach(self, link: str) -> dict[int, float]:
        """Bounds, per joint that moves a link, how far the link's shapes lie from the joint [m]."""
        pin_model = self._kinematics.model.pin_model
        joint = pin_model.frames[self._kinematics.model.frame_id(link)].parentJoint
        reach = max(
            float(np.linalg.norm(shape.placement.translation)) + float(shape.geometry.aabb_radius)
            for shape in (self._geometry.geometryObjects[i] for i in self._shapes_of(link))
        )
        found: dict[int, float] = {}
        while joint > 0:
            found[int(pin_model.idx_vs[joint])] = reach
            reach += float(np.linalg.norm(pin_model.jointPlacements[joint].translation))
            joint = pin_model.parents[joint]
        return found
