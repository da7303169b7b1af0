# SPDX-License-Identifier: BSD-3-Clause
"""Limits of a probe: range, speed and torque of each joint with a margin, distances of links, and the start posture."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.errors import BadInput
from impedance_modules.robot.distances import Distances
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_spec import RobotSpec

Weight = Callable[[Array], Array]
"""Postures (N, n) [rad] -> torque of the links' weight, (N, n) [N.m]."""

POSITION_MARGIN = 0.1
"""Part of a joint's range that a probe keeps away from either end."""

POSITION_MARGIN_MAX = 0.2
"""Largest such margin [rad]."""

VELOCITY_SHARE = 0.6
"""Part of a joint's declared speed that a probe uses."""

EFFORT_SHARE = 0.7
"""Part of a joint's torque limit that a probe uses, weight included."""

ENDLESS = np.pi
"""Range on either side of zero of a joint without limits [rad]."""

UNSTATED_SPEED = 1.0
"""Speed of a joint whose URDF states none [rad/s]."""

STEP = 0.05
"""Time between postures of a path at which distances are measured [s]."""

DISTANCE_FACTOR = 2.0
"""Distance between links that a probe keeps, as a multiple of the robot's own margin."""

DRAWN, TRIES = 4000, 200
"""Number of random postures, from a fixed seed, and of those with least weight whose distances are measured."""

DRAWN_RANGE = 0.3
"""Part of a joint's range on either side of its middle from which random postures are drawn."""

START_MARGIN = 0.15
"""Distance that a recorded start needs to either end of a joint's range [rad]."""

WEIGHT_SHARE = 0.7
"""Largest part of a probe's allowed torque that the weight may need at the start; the rest is for moving."""


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits of every joint less margins, (n,) in the model's joint order.

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
        """Says where a motion (N, n) leaves the limits; None where it does not."""
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


def limits_of_robot(spec: RobotSpec, joints: tuple[str, ...]) -> MotionLimits:
    """Takes the limits of a robot folder."""
    drives = [spec.joints[name] for name in joints]
    return _with_margins(
        joints,
        np.array([drive.position_min for drive in drives]),
        np.array([drive.position_max for drive in drives]),
        np.array([drive.velocity_max for drive in drives]),
        np.array([drive.effort_max for drive in drives]),
    )


def limits_of_model(model: NominalModel) -> MotionLimits:
    """Takes the limits that the URDF states.

    Raises:
        BadInput: A joint is prismatic: the motions of the library are angles.
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
    return _with_margins(model.joints, np.array(lower), np.array(upper), np.array(speed), model.effort_max)


def _with_margins(
    joints: tuple[str, ...], lower: Array, upper: Array, velocity: Array, effort: Array
) -> MotionLimits:
    margin = np.minimum(POSITION_MARGIN * (upper - lower), POSITION_MARGIN_MAX)
    return MotionLimits(
        joints, lower + margin, upper - margin, VELOCITY_SHARE * velocity, EFFORT_SHARE * effort
    )


class Clearance:
    """Measures the declared pairs of links; joints in the order of a diagnosis."""

    def __init__(self, spec: RobotSpec, joints: tuple[str, ...]) -> None:
        self._model = RobotModel(spec)
        self._order = [joints.index(name) for name in self._model.joint_names]
        self._kinematics = Kinematics(self._model, ())
        margin = spec.collision.margin
        # A period longer than any wait, so that every pair is measured at every posture.
        self._distances = Distances(
            self._kinematics,
            spec.collision.pairs,
            margin=margin,
            approach_time=STEP,
            horizon=STEP,
            period=1.0,
        )
        self.needed = DISTANCE_FACTOR * spec.collision.margin

    def nearest(self, postures: Array) -> tuple[float, str]:
        """Finds the smallest distance [m] over postures (N, n), and the pair; infinite without declared pairs."""
        best, pair = np.inf, ""
        if not self._distances.pairs:
            return best, pair
        at_rest = np.zeros(self._model.n)
        for posture in postures[:, self._order]:
            self._kinematics.update(posture, at_rest)
            self._distances.update(posture, at_rest)
            index = int(np.argmin(self._distances.distance))
            if self._distances.distance[index] < best:
                best = float(self._distances.distance[index])
                pair = " and ".join(self._distances.pairs[index])
        return best, pair


def choose_start(
    limits: MotionLimits, recorded: Mapping[str, float], clearance: Clearance | None, weight: Weight
) -> Array:
    """Chooses the posture at which a probe begins and ends, (n,) [rad].

    Args:
        limits: Limits.
        recorded: Joint -> angle about which was recorded.
        clearance: Of the links; None where they are not known.
        weight: Of the links.

    Raises:
        BadInput: Links are too near each other in every posture that was tried.
    """
    middle, span = 0.5 * (limits.lower + limits.upper), limits.upper - limits.lower
    known = np.array([recorded.get(name, middle[i]) for i, name in enumerate(limits.joints)])
    free = np.minimum(START_MARGIN, 0.4 * span)
    known = np.clip(known, limits.lower + free, limits.upper - free)
    random = np.random.default_rng(0)
    drawn = middle + DRAWN_RANGE * span * random.uniform(-1.0, 1.0, (DRAWN, len(span)))
    postures = np.clip(np.vstack([known, drawn]), limits.lower + free, limits.upper - free)
    load = np.max(np.abs(weight(postures)) / limits.effort, axis=1)
    lightest = np.append(0, 1 + np.argsort(load[1:])[:TRIES])
    postures, load = postures[lightest], load[lightest]
    if clearance is None:
        return np.asarray(np.round(postures[0 if load[0] <= WEIGHT_SHARE else int(np.argmin(load))], 3))
    distance = np.array([clearance.nearest(posture[None])[0] for posture in postures])
    free_enough = distance >= clearance.needed
    if not free_enough.any():
        raise BadInput(
            f"in {TRIES} postures links come within {clearance.needed:g} m of each other"
            " (valid: a diagnosis recorded in a posture with more room)"
        )
    light = free_enough & (load <= WEIGHT_SHARE)
    if light[0]:
        return np.asarray(np.round(known, 3))
    best = (
        np.argmax(np.where(light, distance, -np.inf))
        if light.any()
        else np.argmin(np.where(free_enough, load, np.inf))
    )
    return np.asarray(np.round(postures[int(best)], 3))
