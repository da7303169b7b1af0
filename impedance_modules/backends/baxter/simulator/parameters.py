# SPDX-License-Identifier: BSD-3-Clause
"""The simulator's constants. [param] parameter server of a real robot; [wiki], [sdk] Rethink's; [assumed] by us."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, cast, get_args

import numpy as np

from impedance_modules.errors import BadInput

TICK = 1e-3
"""The robot's own loop [s] [wiki]."""

DEFAULT_TIME_OUT = 0.2
LONGEST_TIME_OUT = 1.0
"""Silence after which a control mode is left [s] [wiki]; longer ones are cut."""

SUPPRESSION_TIME_OUT = 0.2
"""A suppression is forgotten unless it is repeated within this time [s] [wiki]."""

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
"""Time by which position mode trails a moving command [s]: 0.23 rad/s trailed by 0.094 rad on a real arm."""

EASE = 0.4
"""Feedback of the links' swing, over sqrt(M_ii / K_sea) [assumed]."""

INTEGRAL_RATE = 1.0
INTEGRAL_LIMIT = 0.05
"""Integral action of the position servo [1/s] and its limit [rad] [assumed]."""

BRAKE_SPEED = 0.2
"""Speed at which full effort would push a powerless joint through its brake [rad/s] [assumed]."""

COLLISION_PAUSE = 2.0
"""Commands are ignored for so long after a collision [s] [wiki]."""

IMPACT_TIME = 0.05
SQUISH_TIME = 0.1
"""A push that rises faster than this is an impact, one that lasts longer than that squishes [s] [assumed]."""

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
"""The mechanical stops lie this far beyond the published limits [rad] [assumed]: tucked arms rest beyond one."""

SPRINGS: Mapping[str, tuple[float, float]] = {"s1": (24.3, -37.3)}
"""Counterbalance spring: stiffness [N.m/rad], torque at zero angle [N.m]. Least squares on public recordings of a
real robot's left arm; a public node for the real robot takes -30 N.m instead."""


TimeOutResult = Literal["hold", "disable", "float"]
OverTorque = Literal["clamp", "fault"]

TIME_OUT_RESULTS: tuple[str, ...] = get_args(TimeOutResult)
OVER_TORQUE: tuple[str, ...] = get_args(OverTorque)


def time_out_result_of(word: str) -> TimeOutResult:
    """Reads what a time-out leads to.

    Raises:
        BadInput: It is no such word.
    """
    for result in get_args(TimeOutResult):
        if word == result:
            return cast(TimeOutResult, result)
    raise BadInput(f"time-out result '{word}' (valid: {', '.join(TIME_OUT_RESULTS)})")


def over_torque_of(word: str) -> OverTorque:
    """Reads what too much torque leads to.

    Raises:
        BadInput: It is no such word.
    """
    for result in get_args(OverTorque):
        if word == result:
            return cast(OverTorque, result)
    raise BadInput(f"over-torque reaction '{word}' (valid: {', '.join(OVER_TORQUE)})")


@dataclass(frozen=True)
class SimulatorOptions:
    """How the simulator is built. Sources disagree about, or are silent on, what the first two say.

    Attributes:
        time_out_result: What follows when torque or velocity commands stop coming: hold in position mode,
            disable the robot, or float under gravity compensation.
        over_torque: What a commanded torque beyond the boards' limit does: it is clamped, or a joint fault.
        enabled: Starts with power on.
        head_nod: Publishes the second head joint that older software has.
        springs: Short joint name -> stiffness [N.m/rad] of the spring beside it and its torque at zero angle [N.m],
            on every limb.
        software_version: As the parameter server tells it.
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
