# SPDX-License-Identifier: BSD-3-Clause
r"""External pushes on a hand or the held object: wrenches that follow a schedule, whatever gives way.

A push grows by minimum jerk over its ``rise``, stays for its ``hold``, and goes by minimum jerk over its ``fall``:

    F(t) = F s(t),     s = 0 | 10 u^3 - 15 u^4 + 6 u^5 | 1 | the same backwards | 0

world axes, at the origin of the hand's frame or of the object. A rise or fall of no time is a jump: a fall of 0 is
a support that is pulled away. The wrench is taken anew once in every loop of the robot (at most 1 ms) and held.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from impedance_modules.errors import BadInput
from impedance_modules.plant.plant_state import PlantState
from impedance_modules.records import Vector
from impedance_modules.spec.task import PushSpec


def push_share(push: PushSpec, time: float) -> float:
    """Gives which part of its wrench a push exerts at a time since the start of the run [s], 0 to 1."""
    since = time - push.start
    left = push.rise + push.hold + push.fall - since
    if since < 0.0 or left <= 0.0:
        return 0.0
    rising = 1.0 if since >= push.rise else since / push.rise
    falling = 1.0 if left >= push.fall else left / push.fall
    u = min(rising, falling)
    return u**3 * (10.0 + u * (6.0 * u - 15.0))


def push_wrench(pushes: Sequence[PushSpec], target: str, time: float) -> Vector:
    """Adds up what all pushes exert on one target at a time [s]: (6,), world axes, at its origin [N, N.m]."""
    total = np.zeros(6)
    for push in pushes:
        if push.target == target:
            total += push_share(push, time) * np.array(push.wrench)
    return total


class Pushes:
    """All pushes of a task on the plant's bodies."""

    def __init__(self, pushes: Sequence[PushSpec], bodies: Mapping[str, int]) -> None:
        """Takes the schedule, and which row of the wrenches belongs to which limb or to ``object``.

        Raises:
            BadInput: A push is on something that the plant does not have.
        """
        for push in pushes:
            if push.target not in bodies:
                raise BadInput(
                    f"the plant has nothing to push called '{push.target}' (valid: {', '.join(bodies)})"
                )
        self._pushes = tuple(pushes)
        self._rows = {push.target: bodies[push.target] for push in pushes}

    def apply(self, plant: PlantState, time: float) -> None:
        """Writes the wrenches of a time [s] into the plant's state."""
        for target, row in self._rows.items():
            plant.push_wrench[row] = push_wrench(self._pushes, target, time)
