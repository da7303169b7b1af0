# SPDX-License-Identifier: BSD-3-Clause
"""What the double is and does where the real robot's behaviour is not known: all of it can be chosen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, cast, get_args

import numpy as np

from impedance_modules.errors import BadInput

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
class FakeOptions:
    """How the double is built. Sources disagree about, or are silent on, what the first two say.

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
