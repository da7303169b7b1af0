# SPDX-License-Identifier: BSD-3-Clause
"""How much of every joint's torque and range a phase uses, and how far its hands yield at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.modules.equilibrium import Equilibrium
from impedance_modules.modules.spring import displacement
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.quasi_static_result import PhaseRehearsal, Rehearsal, Rest
from impedance_modules.robot.model import Limb, RobotModel

Array = NDArray[np.float64]

LOOKS = 40
"""Moments of a phase at which the arms' own weight is taken into account."""


@dataclass(frozen=True)
class JointLoad:
    """The joint of an arm that comes closest to its torque limit.

    Attributes:
        joint: Its name.
        short: Its name within the limb.
        torque: Largest magnitude [N.m].
        limit: ``effort_max`` [N.m].
    """

    joint: str
    short: str
    torque: float
    limit: float

    @property
    def share(self) -> float:
        """Torque over limit."""
        return self.torque / self.limit


@dataclass(frozen=True)
class Yielding:
    """How far something at rest is from its equilibrium: distance [m] and angle [rad]."""

    distance: float
    angle: float


@dataclass(frozen=True)
class ArmForecast:
    """What one phase asks of one arm.

    Attributes:
        limb: The arm.
        commanded: Joint whose commanded torque comes closest to the limit, in the rehearsal or at rest.
        total: The same with the torque that carries the arm's own weight. The limit is the motor's; springs
            that help a real robot carry its arms are not in its description, so this is an upper bound.
        beyond: Joint -> how far it would leave its range [rad]; empty if none does.
        yielding: Of the hand at rest, against its springs; None without a spring there or without a rest.
        pressed: Force of the surfaces on the hand at rest [N]; None without a rest.
    """

    limb: str
    commanded: JointLoad
    total: JointLoad
    beyond: dict[str, float]
    yielding: Yielding | None
    pressed: float | None


def forecast_arm(
    mechanism: Mechanism, limb: Limb, phase: PhaseRehearsal, rehearsal: Rehearsal, rest: Rest | None
) -> ArmForecast:
    """Sums up one arm in one phase."""
    model, samples = mechanism.model, rehearsal.samples[phase.samples]
    efforts = [sample.effort for sample in samples]
    looks = [*samples[:: max(1, len(samples) // LOOKS)]]
    loaded = [sample.effort + model.gravity(sample.q) for sample in looks]
    if rest is not None:
        efforts.append(rest.effort)
        loaded.append(rest.effort + model.gravity(rest.q))
    return ArmForecast(
        limb=limb.name,
        commanded=_worst(model, limb, efforts),
        total=_worst(model, limb, loaded),
        beyond=_beyond(model, limb, [sample.q for sample in samples]),
        yielding=None if rest is None else _hand_yielding(mechanism, limb, phase, rest),
        pressed=None if rest is None else float(np.linalg.norm(rest.pressure[limb.hand][:3])),
    )


def object_yielding(mechanism: Mechanism, targets: Equilibrium, rest: Rest) -> Yielding | None:
    """Gives how far the held object at rest is from its target; None without an object."""
    if targets.object is None:
        return None
    mechanism.update(rest.q, np.zeros_like(rest.q))
    return _yielding(displacement(mechanism.object_pose(), targets.object))


def _worst(model: RobotModel, limb: Limb, efforts: Sequence[Array]) -> JointLoad:
    largest = np.max(np.abs(np.array(efforts)), axis=0)
    limit = model.column("effort_max")
    place = int(np.argmax((largest / limit)[limb.joints]))
    joint = int(limb.joints[place])
    return JointLoad(
        limb.joint_names[place], limb.short_names[place], float(largest[joint]), float(limit[joint])
    )


def _beyond(model: RobotModel, limb: Limb, positions: Sequence[Array]) -> dict[str, float]:
    q = np.array(positions)
    low, high = model.column("position_min"), model.column("position_max")
    outside = np.max(np.maximum(low - q, q - high), axis=0)
    return {model.joint_names[j]: float(outside[j]) for j in limb.joints if outside[j] > 0.0}


def _hand_yielding(mechanism: Mechanism, limb: Limb, phase: PhaseRehearsal, rest: Rest) -> Yielding | None:
    """Takes the hand's spring that is stretched farthest."""
    springs = [s for s in phase.modules.arm(limb.name).springs if s.frame == limb.hand]
    if not springs:
        return None
    pose = mechanism.model.pose(rest.q, limb.hand)
    targets = phase.equilibrium.springs
    found = [_yielding(displacement(pose, targets[spring.name])) for spring in springs]
    return max(found, key=lambda yielding: yielding.distance)


def _yielding(offset: Array) -> Yielding:
    return Yielding(float(np.linalg.norm(offset[:3])), float(np.linalg.norm(offset[3:])))
