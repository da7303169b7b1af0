# SPDX-License-Identifier: BSD-3-Clause
"""The effects this version knows, by id, and how a robot wears a patch of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from impedance_modules.effects import reflected_inertia
from impedance_modules.errors import BadInput
from impedance_modules.spec.patch import EffectSpec, PatchSpec
from impedance_modules.spec.robot import RobotSpec

WEAR: Mapping[str, Callable[[RobotSpec, EffectSpec], RobotSpec]] = {
    reflected_inertia.ID: reflected_inertia.wear,
}
"""Effects that change numbers of the robot file, and so both the plant and the model."""


def wear_patch(robot: RobotSpec, patch: PatchSpec) -> RobotSpec:
    """Returns the robot as the patch describes it.

    Raises:
        BadInput: The patch is for another robot, or holds an effect that cannot be worn.
    """
    if patch.robot != robot.name:
        raise BadInput(f"{patch.path}: the patch is for robot '{patch.robot}', the task uses '{robot.name}'")
    for effect in patch.effects:
        if effect.effect not in WEAR:
            raise BadInput(
                f"{patch.path}: effect '{effect.effect}' cannot be worn by this version"
                f" (valid: {', '.join(WEAR)})"
            )
        robot = WEAR[effect.effect](robot, effect)
    return robot
