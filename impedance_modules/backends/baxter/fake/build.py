# SPDX-License-Identifier: BSD-3-Clause
"""Puts a double together from a robot folder, a posture, a patch and options."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.baxter.fake.numbers import MIRRORED, NEUTRAL, TUCKED, UNTUCKED
from impedance_modules.backends.baxter.fake.options import FakeOptions
from impedance_modules.backends.baxter.fake.robot import FakeBaxter
from impedance_modules.backends.baxter.fake.served import served_description, write_description
from impedance_modules.effects.wear import wear_patch, wear_plant
from impedance_modules.errors import BadInput
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.patch import PatchSpec
from impedance_modules.spec.robot import RobotSpec
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.task_reader import read_task

Array = NDArray[np.float64]

POSTURES: Mapping[str, Mapping[str, float]] = {"neutral": NEUTRAL, "tucked": TUCKED, "untucked": UNTUCKED}
"""Of the arm whose angles are not mirrored."""


@dataclass(frozen=True)
class BuiltFake:
    """A double, and the description that it serves."""

    robot: FakeBaxter
    description: str


def named_posture(spec: RobotSpec, name: str) -> dict[str, dict[str, float]]:
    """Finds the posture of every limb by a name of ``POSTURES`` or by a task, limb -> short name -> [rad].

    A limb that the task leaves out stands at the neutral posture.

    Raises:
        BadInput: Neither; or the task is for another robot.
    """
    # The last limb of the mirror's pair carries the numbers, the others their mirror image.
    plain = min(spec.limbs)
    by_name = POSTURES.get(name, NEUTRAL)
    found = {
        limb: {
            short: by_name[short] if limb == plain else MIRRORED[short] * by_name[short]
            for short in spec.limbs[limb].joints
        }
        for limb in spec.limbs
    }
    if name in POSTURES:
        return found
    try:
        task, robot = read_task(name)
    except BadInput as error:
        raise BadInput(f"posture '{name}': {error} (valid besides tasks: {', '.join(POSTURES)})") from None
    if robot.name != spec.name:
        raise BadInput(
            f"posture '{name}': the task is for robot '{robot.name}' (valid: one for '{spec.name}')"
        )
    found.update({arm: dict(task.arms[arm].posture) for arm in task.arms})
    return found


def build_fake(robot: str, posture: str, patch: PatchSpec | None, options: FakeOptions) -> BuiltFake:
    """Builds a double; takes some seconds, for the compiler.

    Args:
        robot: Robot folder.
        posture: Where it stands, see ``named_posture``.
        patch: Effects that it wears and does not tell, or None.
        options: How it behaves.

    Raises:
        BadInput, BadFile: Something does not fit.
    """
    spec = read_robot(robot)
    stands = named_posture(spec, posture)
    if patch is not None:
        spec = wear_patch(spec, patch)
    text = served_description(spec, options.mount_offset)
    with tempfile.TemporaryDirectory() as folder:
        model = RobotModel(replace(spec, urdf=write_description(text, Path(folder))))
        worn = None if patch is None else wear_plant(model, patch)
        return BuiltFake(FakeBaxter(model, worn, model.position(stands), options), text)
