# SPDX-License-Identifier: BSD-3-Clause
r"""Distances between links, and how they change with the joints.

For a pair of links with closest points A and B and unit normal n from A to B (world axes):

    distance d [m],      d' = G v,      G = n^T (J_B - J_A)      (1, n) [m/rad],      d'' = G v' + G' v

G' v is the drift: links turn about their joints and the closest points wander over them, both seen in how G changes
from one measurement to the next. No curvature of a shape is asked for.

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

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.errors import BadInput
from impedance_modules.records import Indices, Matrix, Record, Vector
from impedance_modules.robot.kinematics import Kinematics

QUICKEST = 20.0
"""Bound of the growth of a pair's closing speed [m/s^2]: a hand of Baxter's pushed by all its torque."""

TURNING_TIME = 0.01
"""Time constant with which the change of a gradient is filtered: encoder steps at a close pair turn it at once [s]."""

LONGEST_WAIT = 0.1
"""A pair is looked at again after this time at the latest [s]."""


class DistanceState(Record):
    """What is known of all pairs; what no cycle changes first.

    Attributes:
        margin: Distance that pairs keep [m].
        approach_time: The damper's T [s].
        horizon: Over which its row looks ahead [s].
        period: Of the control cycle [s].
        moving: (shape pairs, n) 1 where a joint moves the second shape, -1 the first, 0 both or none.
        cycle: Now.
        shapes: (pairs,) the nearest pair of shapes of each.
        before: (pairs,) likewise when measured the time before.
        found: (pairs, 7) distance [m], normal, closest point on the first shape (world axes), when last measured.
        distance: (pairs,) [m].
        gradient: (pairs, n) G; zero where a pair cannot matter in this cycle.
        direction: (pairs, n) G when last measured, near or far.
        turning: (pairs, n) its rate of change, filtered [m/(rad.s)].
        drift: (pairs,) G' v, how the distance accelerates at constant joint velocities [m/s^2].
        seen: (pairs,) cycle in which each was measured last.
        due: (pairs,) cycle in which each is measured again.
    """

    margin: float
    approach_time: float
    horizon: float
    period: float
    moving: Matrix
    cycle: int
    shapes: Indices
    before: Indices
    found: Matrix
    distance: Vector
    gradient: Matrix
    direction: Matrix
    turning: Matrix
    drift: Vector
    seen: Indices
    due: Indices


@compiled
def free_time(state: DistanceState, distance: float, closing: float) -> float:
    """Bounds from below how long a pair cannot matter [s].

    The first t of the inequality above, with c' = max(c, 0) for c: a pair that parts may turn around at once.

    Args:
        state: For its constants.
        distance: d now [m].
        closing: c now [m/s].
    """
    closing = max(closing, 0.0)
    room = distance - state.margin - (closing + QUICKEST * state.horizon) * state.approach_time
    if room <= 0.0:
        return 0.0
    slope = QUICKEST * state.approach_time + closing
    return min(LONGEST_WAIT, (math.sqrt(slope * slope + 2.0 * QUICKEST * room) - slope) / QUICKEST)


@compiled
def book(state: DistanceState, pairs: Indices, jacobian: Array, velocity: Array) -> None:
    """Writes down what was measured in one cycle, and when each pair is measured again.

    Args:
        state: Of all pairs; ``found`` and ``shapes`` hold what was measured.
        pairs: (m,) which ones were measured.
        jacobian: (6, n) the joints' twists at the world's origin, linear then angular.
        velocity: (n,) of the joints [rad/s].
    """
    n, due = velocity.size, state.due
    for pair in pairs:
        found = state.found[pair]
        x, y, z = found[1], found[2], found[3]
        a, b, c = found[4], found[5], found[6]
        # n . velocity of a point p of a link is n . v_0 + (p x n) . w; both closest points lie on one line along n.
        p, q, r = b * z - c * y, c * x - a * z, a * y - b * x
        rate, drift = 0.0, 0.0
        share, since = _share_of_turning(state, pair)
        for j in range(n):
            mark = state.moving[state.shapes[pair], j]
            entry = 0.0
            if mark != 0.0:
                entry = mark * (
                    x * jacobian[0, j]
                    + y * jacobian[1, j]
                    + z * jacobian[2, j]
                    + p * jacobian[3, j]
                    + q * jacobian[4, j]
                    + r * jacobian[5, j]
                )
            change = (entry - state.direction[pair, j]) / since
            state.turning[pair, j] = (1.0 - abs(share)) * state.turning[pair, j] + max(share, 0.0) * change
            state.direction[pair, j] = state.gradient[pair, j] = entry
            rate += entry * velocity[j]
            drift += state.turning[pair, j] * velocity[j]
        free = free_time(state, found[0], -rate)
        state.distance[pair], state.drift[pair], state.seen[pair] = found[0], drift, state.cycle
        if free >= state.period:
            state.gradient[pair] = 0.0
        due[pair] = _free_cycle(due, state.cycle, state.cycle + max(1, int(free / state.period)))


@compiled
def _share_of_turning(state: DistanceState, pair: int) -> tuple[float, float]:
    """How much of a new change of the gradient counts, and since when it changed [s]; -1: what was known is void."""
    since = (state.cycle - state.seen[pair]) * state.period
    if state.shapes[pair] != state.before[pair] or since > TURNING_TIME + state.period:
        return -1.0, state.period
    return 1.0 - math.exp(-since / TURNING_TIME), since


@compiled
def _free_cycle(due: Indices, cycle: int, latest: int) -> int:
    """Finds the last cycle up to ``latest`` in which nothing else is due yet; the next one if there is none."""
    while latest > cycle + 1 and (due == latest).any():
        latest -= 1
    return latest


class Distances:
    """Signed distances of the robot's declared pairs of links.

    Attributes:
        pairs: (link, link) names.
        state: The record that laws read; ``distance`` and ``gradient`` are its own.
        distance: (pairs,) last measured distance [m].
        gradient: (pairs, n) G; zero where the pair cannot matter in this cycle.
        drift: (pairs,) G' v [m/s^2].
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
        """Prepares to measure; arguments as in ``DistanceState``, ``pairs`` as (link, link) names."""
        self.pairs = tuple(pairs)
        self._kinematics = kinematics
        self._geometry = kinematics.model.geometry({link for pair in self.pairs for link in pair})
        self._shapes = [self._shape_pairs(first, second) for first, second in self.pairs]
        self._data = pin.GeometryData(self._geometry)
        moves = [self._moves(both.second) - self._moves(both.first) for both in self._geometry.collisionPairs]
        count, n = len(self.pairs), kinematics.model.n
        # A live view: columns are the joints' twists at the world's origin.
        self._world_jacobian: Array = kinematics.pin_data.J
        self.state = DistanceState(
            margin=margin,
            approach_time=approach_time,
            horizon=horizon,
            period=period,
            moving=np.array(moves).reshape(-1, n),
            cycle=0,
            shapes=np.zeros(count, dtype=np.int64),
            found=np.zeros((count, 7)),
            distance=np.full(count, np.inf),
            gradient=np.zeros((count, n)),
            direction=np.zeros((count, n)),
            turning=np.zeros((count, n)),
            drift=np.zeros(count),
            before=np.full(count, -1, dtype=np.int64),
            seen=np.zeros(count, dtype=np.int64),
            due=np.zeros(count, dtype=np.int64),
        )
        self.distance, self.gradient, self.drift = self.state.distance, self.state.gradient, self.state.drift

    def skip(self) -> None:
        """Lets a cycle without a state go by."""
        self.state.cycle += 1

    def update(self, q: Array, v: Array) -> None:
        """Measures the pairs that may matter, at the state (n,), (n,) of the last ``Kinematics.update``."""
        self.state.cycle += 1
        pairs = np.flatnonzero(self.state.due <= self.state.cycle)
        # A state that is not finite gives no torque, so it needs no distance; the geometry library may not end.
        if pairs.size == 0 or not math.isfinite(float(q @ v)):
            return
        model, data = self._kinematics.model.pin_model, self._kinematics.pin_data
        pin.updateGeometryPlacements(model, data, self._geometry, self._data)
        for pair in pairs.tolist():
            self._measure(pair)
        book(self.state, pairs, self._world_jacobian, v)

    def _measure(self, pair: int) -> None:
        """Measures a pair and writes the result into its row of ``found``."""
        index, result = self._nearest(self._shapes[pair])
        row = self.state.found[pair]
        self.state.before[pair], self.state.shapes[pair] = self.state.shapes[pair], index
        row[0], row[1:4], row[4:] = result.min_distance, result.normal, result.getNearestPoint1()

    def _nearest(self, shapes: list[int]) -> tuple[int, pin.DistanceResult]:
        """Measures pairs of shapes and returns the nearest one."""
        found = [pin.computeDistance(self._geometry, self._data, index) for index in shapes]
        if len(found) == 1:
            return shapes[0], found[0]
        nearest = min(range(len(found)), key=lambda i: float(found[i].min_distance))
        return shapes[nearest], found[nearest]

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
