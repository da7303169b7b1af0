# SPDX-License-Identifier: BSD-3-Clause
"""The torques of a stop: damping that only ever takes energy, and springs that hold the measured pose."""

from __future__ import annotations

import numpy as np

from impedance_modules.records import Vector


def damping_effort(damping: Vector, v: Vector, effort_max: Vector) -> Vector:
    """Brakes all joints without pushing anywhere.

    ``tau = -s D v``, s in (0, 1] the largest that keeps every ``|tau_i| <= effort_max_i``. One s for all
    joints keeps the direction, so ``tau . v = -s v^T D v <= 0``; clipping joint by joint would not
    promise that.

    Args:
        damping: (n, n) symmetric positive semidefinite joint damping D_j [N.m.s/rad].
        v: (n,) last measured joint velocity [rad/s].
        effort_max: (n,) [N.m].

    Returns:
        (n,) [N.m].
    """
    return _within(-(damping @ v), effort_max)


def hold_effort(
    stiffness: Vector, damping: Vector, *, q: Vector, q_hold: Vector, v: Vector, effort_max: Vector
) -> Vector:
    """Holds a pose where the robot has no position mode: stiff, and a gradient plus damping, so payable.

    ``tau = s (K (q_hold - q) - D v)``, s in (0, 1] within the limits. q_hold is the pose measured when the
    hold began, so its springs begin with U = 0 and cost the tank nothing to put on.

    Args:
        stiffness: (n, n) symmetric positive semidefinite [N.m/rad].
        damping: (n, n) symmetric positive semidefinite [N.m.s/rad].
        q: (n,) now [rad].
        q_hold: (n,) at the beginning of the hold [rad].
        v: (n,) [rad/s].
        effort_max: (n,) [N.m].

    Returns:
        (n,) [N.m].
    """
    return _within(stiffness @ (q_hold - q) - damping @ v, effort_max)


def hold_potential(stiffness: Vector, q: Vector, q_hold: Vector) -> float:
    """Energy in the springs of ``hold_effort`` [J]: ``U = (q - q_hold)^T K (q - q_hold) / 2``."""
    stretch = q - q_hold
    return 0.5 * float(stretch @ stiffness @ stretch)


def _within(effort: Vector, effort_max: Vector) -> Vector:
    """The torque scaled as a whole until no joint exceeds its limit."""
    excess = float(np.max(np.abs(effort) / effort_max, initial=1.0))
    scaled: Vector = effort / excess
    return scaled
