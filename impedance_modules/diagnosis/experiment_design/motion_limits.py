# SPDX-License-Identifier: BSD-3-Clause
"""How far, how fast and how strongly each joint may be moved by a probe: the robot's limits with a margin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.errors import BadInput
from impedance_modules.spec.robot_spec import RobotSpec

Array = NDArray[np.float64]

POSITION_MARGIN = 0.1
"""Part of a joint's range that a probe keeps away from either end."""

POSITION_MARGIN_MAX = 0.2
"""The same at most [rad]."""

VELOCITY_SHARE = 0.6
"""Part of a joint's declared speed that a probe uses."""

EFFORT_SHARE = 0.7
"""Part of a joint's torque limit that a probe uses, weight included."""

ENDLESS = np.pi
"""Range on either side of zero of a joint without limits [rad]."""

UNSTATED_SPEED = 1.0
"""Speed of a joint whose URDF states none [rad/s]."""


@dataclass(frozen=True, eq=False)
class Room:
    """What a probe may use of every joint, margins taken off; (n,) in the model's joint order.

    Attributes:
        joints: Names.
        lower, upper: Position [rad].
        velocity: Speed [rad/s].
        effort: Torque of the motor, weight included [N.m]; infinite where nothing is stated.
    """

    joints: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    effort: Array

    def violation(self, position: Array, velocity: Array, effort: Array) -> str | None:
        """Says where a motion (N, n) leaves the room; None where it does not."""
        checks = (
            ("position", "rad", np.max(position - self.upper, axis=0)),
            ("position", "rad", np.max(self.lower - position, axis=0)),
            ("speed", "rad/s", np.max(np.abs(velocity), axis=0) - self.velocity),
            ("torque", "N.m", np.max(np.abs(effort), axis=0) - self.effort),
        )
        for what, unit, over in checks:
            worst = int(np.argmax(over))
            if over[worst] > 1e-9:
                return (
                    f"{what} of {self.joints[worst]} passes its limit less margin by {over[worst]:.3g} {unit}"
                )
        return None


def room_of_robot(spec: RobotSpec, joints: tuple[str, ...]) -> Room:
    """Takes the limits of a robot folder."""
    drives = [spec.joints[name] for name in joints]
    return _room(
        joints,
        np.array([drive.position_min for drive in drives]),
        np.array([drive.position_max for drive in drives]),
        np.array([drive.velocity_max for drive in drives]),
        np.array([drive.effort_max for drive in drives]),
    )


def room_of_model(model: NominalModel) -> Room:
    """Takes the limits that the URDF states.

    Raises:
        BadInput: A joint slides: the motions of the library are angles.
    """
    lower, upper, speed = [], [], []
    for body in model.tree.bodies:
        if body.prismatic:
            raise BadInput(
                f"joint '{body.joint}' slides, and probes turn joints (valid: a robot whose joints turn)"
            )
        known = body.limits
        bounded = known is not None and known.upper > known.lower
        lower.append(known.lower if known is not None and bounded else -ENDLESS)
        upper.append(known.upper if known is not None and bounded else ENDLESS)
        speed.append(known.velocity if known is not None and known.velocity > 0.0 else UNSTATED_SPEED)
    return _room(model.joints, np.array(lower), np.array(upper), np.array(speed), model.effort_max)


def _room(joints: tuple[str, ...], lower: Array, upper: Array, velocity: Array, effort: Array) -> Room:
    margin = np.minimum(POSITION_MARGIN * (upper - lower), POSITION_MARGIN_MAX)
    return Room(joints, lower + margin, upper - margin, VELOCITY_SHARE * velocity, EFFORT_SHARE * effort)
