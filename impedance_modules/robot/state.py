# SPDX-License-Identifier: BSD-3-Clause
"""What the robot reports in one cycle, as one read-only snapshot."""

from __future__ import annotations

from dataclasses import dataclass

from impedance_modules.arrays import Array


@dataclass(frozen=True)
class RobotState:
    """State of all joints, sampled together, in the model's joint order.

    Attributes:
        time: Of the sample, on the robot's clock [s].
        position: (n,) [rad].
        velocity: (n,) [rad/s], the robot's own estimate.
        effort: (n,) measured torque between gearbox and link [N.m].
    """

    time: float
    position: Array
    velocity: Array
    effort: Array
