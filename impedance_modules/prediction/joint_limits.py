# SPDX-License-Identifier: BSD-3-Clause
"""Where a predicted motion meets what it does not know: the ends of joints' ranges, their top speeds, a swinging loop.

The quasi-static prediction lets joints pass their limits; a run's filter does not. What springs, filter and elastic
joints then do together is dynamic, and no prediction here: such a task is tried on the plant (``runs.trial_run``).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array, Indices
from impedance_modules.prediction.feasibility import TaskPrediction
from impedance_modules.prediction.quasi_static import PredictedPhase
from impedance_modules.robot.model import RobotModel

SWINGS_ON = 0.02
"""Damping ratio below which a loop swings on when noise or a limit excites it; Baxter's arms alone have 0.05."""


def beyond_range(model: RobotModel, joints: Indices, positions: Sequence[Array]) -> dict[str, float]:
    """Says how far each joint would leave its range [rad], by name; empty if none does.

    Args:
        model: Of the robot.
        joints: Indices that are looked at.
        positions: (n,) each [rad].
    """
    q = np.array(positions)
    low, high = model.column("position_min"), model.column("position_max")
    outside = np.max(np.maximum(low - q, q - high), axis=0)
    return {model.joint_names[j]: float(outside[j]) for j in joints if outside[j] > 0.0}


def too_fast(model: RobotModel, joints: Indices, velocities: Sequence[Array]) -> dict[str, float]:
    """Says what speed each joint would reach that passes its limit [rad/s], by name; arguments as ``beyond_range``."""
    fastest, limit = np.max(np.abs(np.array(velocities)), axis=0), model.column("velocity_max")
    return {model.joint_names[j]: float(fastest[j]) for j in joints if fastest[j] > limit[j]}


@dataclass(frozen=True)
class LimitsMet:
    """What a prediction says that it does not know.

    Attributes:
        joints: Which joints would meet a limit, phase by phase, in words.
        swings: Which loops would swing on, likewise.
    """

    joints: tuple[str, ...]
    swings: tuple[str, ...]

    @property
    def first(self) -> str:
        """The first of all, in words."""
        return (self.joints + self.swings)[0]

    def __bool__(self) -> bool:
        """Tells whether there is anything."""
        return bool(self.joints or self.swings)


def limits_met(model: RobotModel, prediction: TaskPrediction) -> LimitsMet:
    """Looks for joints that would meet a limit and for loops that would swing on, in every phase."""
    joints: list[str] = []
    swings: list[str] = []
    for phase, judged in zip(prediction.motion.phases, prediction.loops, strict=True):
        joints.extend(_joints_at_limits(model, prediction, phase))
        for loop in judged.loops:
            if loop.damping_ratio is not None and loop.damping_ratio < SWINGS_ON:
                swings.append(
                    f"phase '{phase.name}': '{loop.name}' has a damping ratio of {loop.damping_ratio:.3f}"
                )
    return LimitsMet(tuple(joints), tuple(swings))


def _joints_at_limits(model: RobotModel, prediction: TaskPrediction, phase: PredictedPhase) -> Iterator[str]:
    """Looks at one phase's samples."""
    samples = prediction.motion.samples[phase.samples]
    joints = np.concatenate([arm.limb.joints for arm in phase.modules.arms])
    for joint, angle in beyond_range(model, joints, [sample.q for sample in samples]).items():
        yield f"phase '{phase.name}': {joint} would leave its range by {angle:.2f} rad"
    for joint, speed in too_fast(model, joints, [sample.velocity for sample in samples]).items():
        yield f"phase '{phase.name}': {joint} would reach {speed:.2f} rad/s"
