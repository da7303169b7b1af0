# SPDX-License-Identifier: BSD-3-Clause
r"""Distances between links, and how they change with the joints.

For a pair of links with closest points A and B and unit normal n from A to B (world axes):

    distance d [m],      d' = G v,      G = n^T (J_B - J_A)      (1, n) [m/rad]

The filter lets a distance accelerate no faster towards its margin than ((d - margin) / T - c) / h, with c = -d' the
closing speed, T the approach time and h the horizon (``safety.rows``). Where no closing speed grows faster than
a = ``QUICKEST``, the row cannot act before

    c + a (t + h) >= (d - margin - c t - a t^2 / 2) / T

So after every measurement it is known for how long a pair cannot matter, and until then it is left alone. Pairs that
would fall due together are measured one after the other, each a little early: a cycle measures one as a rule.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.errors import BadInput
from impedance_modules.robot.kinematics import Kinematics

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
        *,
        margin: float,
        approach_time: float,
        horizon: float,
        period: float,
    ) -> None:
        """Prepares to measure.

        Args:
            kinematics: Of the robot.
            pairs: (link, link) names.
            margin: Distance that pairs keep [m].
            approach_time: The damper's T [s].
            horizon: Over which its row looks ahead [s].
            period: Of the control cycle [s].
        """
        self.pairs = tuple(pairs)
        self._kinematics = kinematics
        self._margin, self._approach_time = margin, approach_time
        self._horizon, self._period = horizon, period
        self._geometry = kinematics.model.geometry()
        self._shapes = [self._shape_pairs(first, second) for first, second in self.pairs]
        self._data = pin.GeometryData(self._geometry)
        self._moving = [
            self._moves(both.second) - self._moves(both.first) for both in self._geometry.collisionPairs
        ]
        # A live view: columns are the joints' twists at the world's origin.
        self._world_jacobian: Array = kinematics.pin_data.J
        self._cycle = 0
        self._due = [0] * len(self.pairs)
        self._next_due = 0 if self.pairs else math.inf
        self.distance: Array = np.full(len(self.pairs), np.inf)
        self.gradient: Array = np.zeros((len(self.pairs), kinematics.model.n))

    def skip(self) -> None:
        """Lets a cycle without a state go by."""
        self._cycle += 1

    def update(self, q: Array, v: Array) -> None:
        """Measures the pairs that may matter, at the state (n,), (n,) of the last ``Kinematics.update``."""
        self._cycle += 1
        if self._cycle < self._next_due:
            return
        # A state that is not finite gives no torque, so it needs no distance; the geometry library may not end.
        if not math.isfinite(float(q @ v)):
            return
        model, data = self._kinematics.model.pin_model, self._kinematics.pin_data
        pin.updateGeometryPlacements(model, data, self._geometry, self._data)
        for pair, due in enumerate(self._due):
            if due <= self._cycle:
                self._measure(pair, v)
        self._next_due = min(self._due)

    def _measure(self, pair: int, v: Array) -> None:
        index, result = self._nearest(self._shapes[pair])
        distance = float(result.min_distance)
        x, y, z = result.normal.tolist()
        a, b, c = result.getNearestPoint1().tolist()
        # n . velocity of a point p of a link is n . v_0 + (p x n) . w; both closest points lie on one line along n.
        line = np.array([x, y, z, b * z - c * y, c * x - a * z, a * y - b * x])
        row = (line @ self._world_jacobian) * self._moving[index]
        free = self.free_time(distance, -float(row @ v))
        self.distance[pair] = distance
        self.gradient[pair] = row if free < self._period else 0.0
        self._due[pair] = self._slot(self._cycle + max(1, int(free / self._period)))

    def _nearest(self, shapes: list[int]) -> tuple[int, pin.DistanceResult]:
        """Measures pairs of shapes and returns the nearest one."""
        found = [pin.computeDistance(self._geometry, self._data, index) for index in shapes]
        if len(found) == 1:
            return shapes[0], found[0]
        nearest = min(range(len(found)), key=lambda i: float(found[i].min_distance))
        return shapes[nearest], found[nearest]

    def _slot(self, latest: int) -> int:
        """Finds the last cycle up to ``latest`` in which nothing else is due yet; the next one if there is none."""
        while latest > self._cycle + 1 and latest in self._due:
            latest -= 1
        return latest

    def free_time(self, distance: float, closing: float) -> float:
        """Bounds from below how long a pair cannot matter [s].

        The first t of the inequality above, with c' = max(c, 0) for c: a pair that parts may turn around at once.

        Args:
            distance: d now [m].
            closing: c now [m/s].
        """
        T, a, closing = self._approach_time, QUICKEST, max(closing, 0.0)
        room = distance - self._margin - (closing + a * self._horizon) * T
        if room <= 0.0:
            return 0.0
        slope = a * T + closing
        return min(LONGEST_WAIT, (math.sqrt(slope**2 + 2.0 * a * room) - slope) / a)

    def _moves(self, shape: int) -> Array:
        """Marks with 1 the joints that move a shape, (n,)."""
        model, marks = self._kinematics.model.pin_model, np.zeros(self._kinematics.model.n)
        for joint in model.supports[self._geometry.geometryObjects[shape].parentJoint]:
            if joint > 0:
                marks[model.idx_vs[joint]] = 1.0
        return marks

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
