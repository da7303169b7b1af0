# SPDX-License-Identifier: BSD-3-Clause
"""The elbow's angle as a task of inverse kinematics; imported only where such a search runs."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pink
from pink.tasks import Task

from impedance_modules.arrays import Array

DIFFERENCE = 1e-6
"""Of the finite differences [rad]."""

LONGEST = 0.5
"""Of the error that one step takes on [rad]."""


class ElbowTask(Task):  # type: ignore[misc]
    """Turns the elbow to an angle about the line from shoulder to hand."""

    def __init__(self, asked: float, angle_at: Callable[[Array], float | None], damping: float) -> None:
        """Takes the angle asked for [rad], and the angle at q (k,), None where there is none."""
        super().__init__(cost=np.full(1, 0.1), gain=1.0, lm_damping=damping)
        self._asked, self._angle_at = asked, angle_at

    def compute_error(self, configuration: pink.Configuration) -> Array:
        """Gives what is left, (1,) [rad]; zero where the elbow has no angle."""
        found = self._angle_at(configuration.q)
        left = 0.0 if found is None else math.remainder(found - self._asked, 2.0 * math.pi)
        return np.full(1, float(np.clip(left, -LONGEST, LONGEST)))

    def compute_jacobian(self, configuration: pink.Configuration) -> Array:
        """Gives the angle's derivative by the joints, (1, k)."""
        out = np.zeros((1, configuration.q.size))
        for joint in range(configuration.q.size):
            ends = []
            for side in (DIFFERENCE, -DIFFERENCE):
                q = configuration.q.copy()
                q[joint] += side
                ends.append(self._angle_at(q))
            if ends[0] is not None and ends[1] is not None:
                out[0, joint] = math.remainder(ends[0] - ends[1], 2.0 * math.pi) / (2.0 * DIFFERENCE)
        return out

    def __repr__(self) -> str:
        return f"ElbowTask({self._asked})"
