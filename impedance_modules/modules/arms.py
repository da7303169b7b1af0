# SPDX-License-Identifier: BSD-3-Clause
"""One arm is one impedance module: its springs and its joint bias. A task is a few of them and an object."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impedance_modules.modules.held_object import HeldObject
from impedance_modules.modules.joint_bias import JointBias
from impedance_modules.modules.spring import Spring
from impedance_modules.robot.model import Limb
from impedance_modules.spec.task import PhaseSpec

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ArmModule:
    """An impedance module: what one arm should feel like.

    Attributes:
        limb: The arm.
        springs: Springs on its frames.
        bias: Joint springs; None for none.
    """

    limb: Limb
    springs: tuple[Spring, ...]
    bias: JointBias | None


@dataclass(frozen=True)
class TaskModules:
    """All impedance modules of a task, and the object between them.

    Attributes:
        arms: In the order of the task file.
        held: The object that arms hold; None for none.
        posture: (n,) q at the start [rad]; joints of limbs without a module are 0.
    """

    arms: tuple[ArmModule, ...]
    held: HeldObject | None
    posture: Array

    @property
    def frames(self) -> tuple[str, ...]:
        """Frames whose pose and Jacobian a cycle needs: hands first, then other springs' frames."""
        hands = [arm.limb.hand for arm in self.arms]
        others = [spring.frame for arm in self.arms for spring in arm.springs]
        return tuple(dict.fromkeys(hands + others))

    def arm(self, limb: str) -> ArmModule:
        """Finds the module of a limb by name."""
        return next(arm for arm in self.arms if arm.limb.name == limb)


def with_phase_gains(modules: TaskModules, phase: PhaseSpec) -> TaskModules:
    """Returns the modules with the hybrid axes and stiffnesses that hold from a phase on."""
    arms = tuple(
        replace(arm, springs=tuple(_with_gains(spring, phase) for spring in arm.springs))
        for arm in modules.arms
    )
    return replace(modules, arms=arms)


def _with_gains(spring: Spring, phase: PhaseSpec) -> Spring:
    axes = phase.axes.get(spring.name, {})
    stiffness = phase.stiffness.get(spring.name)
    return spring if not axes and stiffness is None else spring.with_gains(axes, stiffness)
