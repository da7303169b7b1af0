# SPDX-License-Identifier: BSD-3-Clause
"""How near the robot's links come to each other and to its body along a motion (`robot.distances`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.robot.distances import Distances
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_spec import RobotSpec

Array = NDArray[np.float64]

STEP = 0.05
"""Time between the postures of a path that are measured [s]."""

ROOM = 2.0
"""Times the robot's own margin that a probe keeps between links."""


class Clearance:
    """Measures the declared pairs of links; joints in the order of a diagnosis."""

    def __init__(self, spec: RobotSpec, joints: tuple[str, ...]) -> None:
        self._model = RobotModel(spec)
        self._order = [joints.index(name) for name in self._model.joint_names]
        self._kinematics = Kinematics(self._model, ())
        margin = spec.collision.margin
        # A period longer than any wait, so that every pair is measured at every posture.
        self._distances = Distances(
            self._kinematics,
            spec.collision.pairs,
            margin=margin,
            approach_time=STEP,
            horizon=STEP,
            period=1.0,
        )
        self.needed = ROOM * spec.collision.margin

    def nearest(self, postures: Array) -> tuple[float, str]:
        """Finds the smallest distance [m] over postures (N, n), and the pair; infinite without declared pairs."""
        best, pair = np.inf, ""
        if not self._distances.pairs:
            return best, pair
        still = np.zeros(self._model.n)
        for posture in postures[:, self._order]:
            self._kinematics.update(posture, still)
            self._distances.update(posture, still)
            index = int(np.argmin(self._distances.distance))
            if self._distances.distance[index] < best:
                best = float(self._distances.distance[index])
                pair = " and ".join(self._distances.pairs[index])
        return best, pair
