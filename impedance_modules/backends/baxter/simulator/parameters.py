# SPDX-License-Identifier: BSD-3-Clause
"""Constants and options of the simulated Baxter, with the source of every number.

[param] parameter server of a real robot; [wiki] and [sdk] Rethink's; [assumed] by us. What is not known of the real
robot can be chosen (``SimulatorOptions``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from impedance_modules.errors import BadInput

TICK = 1e-3
"""The robot's own loop [s] [wiki]."""

DEFAULT_TIME_OUT = 0.2
LONGEST_TIME_OUT = 1.0
"""Time without a command after which a control mode is left [s] [wiki]; longer ones are clipped."""

SUPPRESSION_TIME_OUT = 0.2
"""A suppression ends unless it is repeated within this time [s] [wiki]."""

DEFAULT_RATE, SLOWEST_RATE, FASTEST_RATE = 100.0, 1.0, 1000.0
"""Of the joint states [Hz] [wiki]; the range is [assumed]."""

GRIPPER_RATE = 38.0
"""Of the gripper's joint states [Hz]: 138 messages of both publishers together on a real robot."""

SLOW_RATE = 10.0
"""Of cuffs and collision flags [Hz] [assumed]; a change is published at once."""

STATE_RATE = 100.0
"""Of /robot/state, gravity torques and endpoint states [Hz]; 99.8 measured for the first on a real robot."""

SPEED_RATIO = 0.3
"""Default of position mode [sdk]."""

POSITION_LAG = 0.4
"""Time by which position mode lags a moving command [s]: 0.094 rad at 0.23 rad/s on a real arm."""

EASE = 0.4
"""Gain of the feedback that damps the links' oscillation, times sqrt(M_ii / K_sea) [assumed]."""

INTEGRAL_RATE = 1.0
INTEGRAL_LIMIT = 0.05
"""Integral action of the position servo [1/s] and its limit [rad] [assumed]."""

BRAKE_SPEED = 0.2
"""Speed at which full effort would move a joint without power against its viscous brake [rad/s] [assumed]."""

COLLISION_PAUSE = 2.0
"""Time for which commands are ignored after a collision [s] [wiki]."""

IMPACT_TIME = 0.05
SQUISH_TIME = 0.1
"""A push that rises faster than the first is an impact, one longer than the second a squish [s] [assumed]."""

IMPACT_THRESHOLD = 0.85
IMPACT_SCALERS: Mapping[str, float] = {"s0": 3.0, "s1": 3.0, "e0": 2.7, "e1": 3.3, "w0": 1.2, "w1": 2.7}
SQUISH_THRESHOLDS: Mapping[str, float] = {
    "s0": 16.0,
    "s1": 16.0,
    "e0": 16.0,
    "e1": 24.0,
    "w0": 7.0,
    "w1": 7.0,
}
"""[param]; N.m is [assumed], and the last wrist joint has none."""

FORCE_FIELD_STIFFNESS = 550.0
FORCE_FIELD_DAMPING = 8.0
"""Of the field that keeps the arms apart [param]; N/m and N.s/m are [assumed]."""

TORQUE_LIMITS: Mapping[str, float] = {"s0": 50, "s1": 50, "e0": 50, "e1": 50, "w0": 15, "w1": 15, "w2": 15}
SPEED_LIMITS: Mapping[str, float] = {"s0": 2, "s1": 2, "e0": 2, "e1": 2, "w0": 4, "w1": 4, "w2": 4}
"""Of the joint boards [N.m], [rad/s] [param]."""

STOP_MARGIN = 0.05
"""Distance of the mechanical stops beyond the published limits [rad] [assumed]: tucked arms rest beyond one limit."""

SPRINGS: Mapping[str, tuple[float, float]] = {"s1": (24.3, -37.3)}
"""Counterbalance spring: stiffness [N.m/rad], torque at zero angle [N.m]. Least squares on public recordings of a
real robot's left arm; a public node for the real robot takes -30 N.m instead."""

TimeOutResult = Literal["hold", "disable", "float"]
OverTorque = Literal["clamp", "fault"]


@dataclass(frozen=True)
class SimulatorOptions:
    """Options of the simulated robot. On the first two, sources disagree or say nothing.

    Attributes:
        time_out_result: What follows when torque or velocity commands stop coming: hold in position mode,
            disable the robot, or float under gravity compensation.
        over_torque: What a commanded torque beyond the boards' limit does: it is clamped, or a joint fault.
        enabled: Starts with power on.
        head_nod: Publishes the second head joint that older software has.
        springs: Short joint name -> stiffness [N.m/rad] of its parallel spring and the torque at zero angle [N.m],
            on every limb.
        software_version: On the parameter server.
        mount_offset: Limb -> calibrated minus nominal position of its mount in the torso's frame (3,) [m].
        seed: Of the sensors' noise.
        noise: Sensor noise as the robot file declares it.
    """

    time_out_result: TimeOutResult = "hold"
    over_torque: OverTorque = "clamp"
    enabled: bool = False
    head_nod: bool = False
    springs: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    software_version: str = "1.2.0.57"
    mount_offset: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    seed: int = 0
    noise: bool = True

    def __post_init__(self) -> None:
        for name, offset in self.mount_offset.items():
            if not (np.isfinite(offset).all() and np.linalg.norm(offset) <= 0.1):
                raise BadInput(
                    f"mount offset of '{name}' is {offset} m (valid: three numbers, together at most 0.1 m)"
                )
