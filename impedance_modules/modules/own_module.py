# SPDX-License-Identifier: BSD-3-Clause
r"""A module of one's own: a potential and a damper written in Python, summed with the others.

    \tau_own = -r dU/dq - d,        U >= 0

U counts in the ledger of the energy tank like that of a spring, relaxed by the same scale r; what the damper takes or
gives is work, which the tank sees at the motors. So the claim (docs/passivity.md) holds whatever a module does: one
whose torque is not the gradient of its energy empties the tank, it does not break the claim. Filter and limits follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.records import Flag, Matrix, Record, Scalar
from impedance_modules.robot.kinematics import Kinematics

OWN = "own."
"""Before the names of such modules in recordings."""


@dataclass(frozen=True)
class OwnTorque:
    """What a module asks for at one state.

    Attributes:
        energy: U, not negative [J].
        spring: (n,) -dU/dq [N.m].
        damper: (n,) torque that stores nothing [N.m].
    """

    energy: float
    spring: Array
    damper: Array


class OwnModule(Protocol):
    """A potential and a damper on the joints of a robot.

    Attributes:
        name: Letters, digits, - and _; unique among the modules of a run.
    """

    name: str

    def torque(self, q: Array, velocity: Array, kinematics: Kinematics) -> OwnTorque:
        """Evaluates the module in a cycle; a function of its arguments alone.

        Args:
            q: (n,) measured [rad].
            velocity: (n,) as the robot reports it [rad/s].
            kinematics: Of q; ``pose(frame)`` and ``jacobian_of(frame)`` of the frames that the task names.
        """


class OwnTorques(Record):
    """What all such modules ask for in this cycle.

    Attributes:
        active: Whether there is any.
        energy: Sum of their energies, unscaled [J].
        spring, damper: (modules, n) [N.m].
        effort: (modules, n) what is in force of each [N.m].
    """

    active: Flag
    energy: Scalar = 0.0
    spring: Matrix
    damper: Matrix
    effort: Matrix


def own_torques(count: int, effort: Array) -> OwnTorques:
    """Takes the memory of ``count`` modules; ``effort`` (count, n) is overwritten in every cycle."""
    return OwnTorques(
        active=count > 0, spring=np.zeros_like(effort), damper=np.zeros_like(effort), effort=effort
    )


def evaluate(
    own: Sequence[OwnModule], into: OwnTorques, q: Array, velocity: Array, kinematics: Kinematics
) -> bool:
    """Asks all modules; returns whether every answer is finite and no energy negative. A wrong shape is not."""
    total = 0.0
    for k, module in enumerate(own):
        found = module.torque(q, velocity, kinematics)
        if np.shape(found.spring) != q.shape or np.shape(found.damper) != q.shape:
            return False
        into.spring[k], into.damper[k] = found.spring, found.damper
        if not found.energy >= 0.0:
            return False
        total += float(found.energy)
    into.energy = total
    return bool(np.isfinite(total) and np.isfinite(into.spring).all() and np.isfinite(into.damper).all())


@compiled
def apply_own(own: OwnTorques, scale: float) -> float:
    """Puts r times the springs, and the dampers, in force; returns the relaxed energy r U [J]."""
    for k in range(own.effort.shape[0]):
        for j in range(own.effort.shape[1]):
            own.effort[k, j] = scale * own.spring[k, j] + own.damper[k, j]
    return scale * own.energy
