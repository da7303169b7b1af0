# SPDX-License-Identifier: BSD-3-Clause
"""What can be wrong with a joint, as one record per joint: every field zero (or one for a gain) is the nominal arm.

Friction acts twice, on the motor and on the link; everything else has one place. SI units throughout.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FRICTION = np.dtype(
    [
        (name, np.float64)
        for name in (
            "fc",  # Coulomb [N.m]
            "fs",  # extra static (Stribeck) above fc [N.m]
            "vs",  # Stribeck speed [rad/s]
            "s0",  # LuGre bristle stiffness [N.m/rad]
            "s1",  # LuGre bristle damping [N.m.s/rad]
            "fv",  # viscous [N.m.s/rad]
            "c",  # quadratic [N.m.s^2/rad^2]
            "da",  # Coulomb more in + than in - direction [N.m]
            "dv",  # viscous more in + than in - direction [N.m.s/rad]
            "kl",  # share of the transmitted torque
            "k",  # share of fv that goes away with warmth
            "T",  # how fast it does [s]
            "pa",  # share of fc that varies with position
            "pn",  # how often per radian
        )
    ]
)

JOINT = np.dtype(
    [
        (name, np.float64)
        for name in (
            "delay",  # of the command [s]
            "lag",  # first-order lag of the motor torque [s]
            "gain",  # of the motor torque
            "limit",  # of the motor torque [N.m]; infinite is none
            "offset",  # constant motor torque [N.m]
            "dead",  # half-width of the driver's dead zone [N.m]
            "kt_a",  # share by which the gain swings
            "kt_T",  # in this time [s]
            "drop",  # share of the command lost while a dropout lasts
            "dkp",  # stiffness of the robot's own controller too much [N.m/rad]
            "dkd",  # its damping [N.m.s/rad]
            "vibration",  # amplitude of a torque tone in time [N.m]
            "tone",  # its frequency [rad/s]
            "ripple",  # amplitude over motor position [N.m]
            "order",  # of the ripple, per radian
            "phase",  # of the ripple [rad]
            "bump",  # height of a damaged tooth [N.m]
            "bump_at",  # where on the tooth belt's pitch [rad]
            "bump_width",  # [rad]
            "bump_every",  # [rad]
            "spring",  # parallel to the joint, link side [N.m/rad]
            "preload",  # its torque at q = 0 [N.m]
            "stop",  # one-sided spring [N.m/rad]
            "stop_at",  # [rad]
            "snag",  # spring of a caught cable [N.m/rad]
            "snag_at",  # [rad]
            "snag_force",  # at which it slips off [N.m]
            "dq0",  # encoder reads q + dq0 [rad]
            "eccentric",  # amplitude of encoder error [rad]
            "eccentric_phase",  # [rad]
            "effort_gain",  # of the joint torque sensor
            "effort_offset",  # [N.m]
            "velocity_lag",  # further first-order lag of the reported velocity [s]
            "freeze",  # 1 where the sensor freezes at times
        )
    ]
)

STATE = np.dtype(
    [
        (name, np.float64)
        for name in ("z_motor", "z_link", "lagged", "caught", "last", "slow", "slower", "started")
    ]
)


@dataclass
class Faults:
    """Everything that is wrong with the drives and sensors of one arm.

    Attributes:
        friction: (2, n) records: on the motors, on the links.
        joint: (n,) records.
        crosstalk: (n, n) share of joint j's torque that sensor i reads too.
        coupling: (n, n) dry friction of a shaft that motors i and j share [N.m].
        clock: Relative error of the sensors' clock against the controller's.
        stamps: Relative error of all time stamps.
    """

    friction: NDArray[np.void]
    joint: NDArray[np.void]
    crosstalk: Array
    coupling: Array
    clock: float = 0.0
    stamps: float = 0.0
    drop_times: list[tuple[float, float]] = field(default_factory=list)
    freeze_times: list[tuple[float, float]] = field(default_factory=list)

    @classmethod
    def none(cls, n: int) -> Faults:
        """Returns an arm without faults."""
        joint = np.zeros(n, JOINT)
        joint["gain"] = joint["effort_gain"] = 1.0
        joint["limit"] = np.inf
        joint["kt_T"] = joint["bump_every"] = 1.0
        friction = np.zeros((2, n), FRICTION)
        friction["vs"] = friction["T"] = 1.0
        return cls(friction, joint, np.zeros((n, n)), np.zeros((n, n)))
