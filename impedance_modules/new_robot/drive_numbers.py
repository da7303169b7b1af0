# SPDX-License-Identifier: BSD-3-Clause
"""The numbers of an arm's joints: those that its description states, and cautious ones where it is silent.

No maker's description states how fast a torque may rise, and few state the rotors. What is written in their place is
on the robot file's list ``assumed``, and ``check`` says what follows from it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from impedance_modules.new_robot.copies import JointLimits
from impedance_modules.new_robot.source_description import SourceDescription

FULL_TORQUE_TIME = 0.025
"""Time from nothing to full torque that is assumed [s]."""

ROTOR_PER_EFFORT = 0.002
"""Assumed inertia of a rotor seen at the joint, for each N.m of the joint's largest torque [kg.m^2/(N.m)].

The geared drives whose numbers are public have 0.001 to 0.017.
"""

DAMPING_PER_EFFORT = 0.002
"""Assumed viscous friction, for each N.m of largest torque [s/rad]; public drives have 0.002 to 0.05."""

SPEED = 1.0
"""Assumed highest speed [rad/s]."""

TURN = 2.0 * math.pi
"""Assumed range to either side of a joint that turns without end [rad]."""

WEIGHT_MARGIN = 1.5
"""Assumed largest torque over what weight asks for at most [1]."""

LEAST_EFFORT = 1.0
"""Smallest torque that is assumed as the largest [N.m]."""

ANY_VELOCITY, ANY_EFFORT = 100.0, 10000.0
"""Limits of a URDF that limit nothing a robot file may state [rad/s], [N.m]."""

Value = float | tuple[float, float] | Literal["rigid"]


@dataclass(frozen=True)
class DriveNumbers:
    """Numbers of the joints of all arms.

    Attributes:
        tables: Quantity of a robot file -> joint, as the description names it -> number.
        assumed: Quantity -> joints whose number the description does not state.
    """

    tables: Mapping[str, Mapping[str, Value]]
    assumed: Mapping[str, tuple[str, ...]]

    def limits(self, joint: str) -> JointLimits:
        """Gives a joint's limits for the URDF; what is assumed does not limit there, so that it can be replaced."""
        position = self.tables["position"][joint]
        lower, upper = position if isinstance(position, tuple) else (-TURN, TURN)
        widest = {"velocity": ANY_VELOCITY, "effort": ANY_EFFORT}
        velocity, effort = (
            most if joint in self.assumed.get(key, ()) else float(self.tables[key][joint])  # type: ignore[arg-type]
            for key, most in widest.items()
        )
        return JointLimits(lower, upper, velocity, effort)


def drive_numbers(
    description: SourceDescription, joints: Sequence[str], weights: Mapping[str, float]
) -> DriveNumbers:
    """Collects the numbers of joints.

    Args:
        description: What states them.
        joints: Of all arms, as the description names them.
        weights: Joint -> largest torque of weight [N.m], for those whose largest torque is not stated.
    """
    tables: dict[str, dict[str, Value]] = {}
    assumed: dict[str, list[str]] = {}

    def enter(quantity: str, joint: str, stated: Value | None, otherwise: Value) -> None:
        tables.setdefault(quantity, {})[joint] = otherwise if stated is None else stated
        if stated is None:
            assumed.setdefault(quantity, []).append(joint)

    for joint in joints:
        limits = description.facts.joints[joint].limits
        turns = limits is not None and limits.lower < limits.upper
        ends = (limits.lower, limits.upper) if limits is not None and turns else None
        speed = limits.velocity if limits is not None and limits.velocity > 0.0 else None
        effort = stated_effort(description, joint)
        likely = max(LEAST_EFFORT, WEIGHT_MARGIN * weights.get(joint, 0.0))
        most = likely if effort is None else effort
        enter("position", joint, ends, (-TURN, TURN))
        enter("velocity", joint, speed, SPEED)
        enter("effort", joint, effort, _two_digits(likely))
        enter("effort_rate", joint, None, _two_digits(most / FULL_TORQUE_TIME))
        enter("spring_stiffness", joint, None, "rigid")
        tables.setdefault("spring_damping", {})[joint] = 0.0
        enter(
            "reflected_inertia",
            joint,
            description.rotor_inertia.get(joint),
            _two_digits(ROTOR_PER_EFFORT * most),
        )
        enter("motor_damping", joint, description.damping.get(joint), _two_digits(DAMPING_PER_EFFORT * most))
    return DriveNumbers(tables, {quantity: tuple(names) for quantity, names in assumed.items()})


def stated_effort(description: SourceDescription, joint: str) -> float | None:
    """Gives a joint's largest torque as the description states it [N.m]; None where it does not."""
    limits = description.facts.joints[joint].limits
    if limits is not None and limits.effort > 0.0:
        return limits.effort
    return description.effort.get(joint)


def _two_digits(value: float) -> float:
    """A guess has no more digits."""
    return float(f"{value:.2g}")
