# SPDX-License-Identifier: BSD-3-Clause
"""One thing that is wrong with an arm, with a size that can still be chosen, and the hands to put it in."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.arm_model import Drive
from benchmarks.blind.plant import Arm

Array = NDArray[np.float64]
Parameters = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class Situation:
    """What an effect may look at when it is drawn.

    Attributes:
        arm: Without the effect.
        joint: That is to have it, for effects of one joint.
        centre: (n,) middle of the motions [rad].
        peak: (n,) largest motor torque of the motions [N.m].
        least: (n,) the same of the motion where it is smallest [N.m].
        weight: (n,) largest weight in any motion [N.m].
        rng: Of the case.
    """

    arm: Arm
    joint: int
    centre: Array
    peak: Array
    least: Array
    weight: Array
    rng: np.random.Generator

    @property
    def drive(self) -> Drive:
        """Numbers of the robot file."""
        return self.arm.drive

    @property
    def name(self) -> str:
        """Of the joint."""
        return self.arm.drive.joints[self.joint]


@dataclass(frozen=True)
class Injection:
    """An effect of chosen shape.

    Attributes:
        effect: Id.
        joints: That have it.
        port: Where it acts.
        first: Amplitude to try first, in the effect's own unit.
        most: Largest amplitude that is still physical.
        apply: (arm, amplitude, episode) -> arm.
        parameters: Amplitude -> truth as a diagnosis would have to report it.
        also: Other effect ids that are true as well.
    """

    effect: str
    joints: tuple[str, ...]
    port: str
    first: float
    most: float
    apply: Callable[[Arm, float, int], Arm]
    parameters: Callable[[float], Parameters]
    also: tuple[str, ...] = ()


Draw = Callable[[Situation], Injection]


def with_joint(arm: Arm, at: int, **values: float) -> Arm:
    """Returns the arm with fields of one joint's record set."""
    faults = copy.deepcopy(arm.faults)
    for key, value in values.items():
        faults.joint[key][at] = value
    return replace(arm, faults=faults)


def with_friction(arm: Arm, port: str, at: int, **values: float) -> Arm:
    """Returns the arm with fields of one joint's friction set, at the ``actuator`` or at the ``link``."""
    faults = copy.deepcopy(arm.faults)
    for key, value in values.items():
        faults.friction[key][0 if port == "actuator" else 1, at] = value
    return replace(arm, faults=faults)
