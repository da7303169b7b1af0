# SPDX-License-Identifier: BSD-3-Clause
"""Puts a double together from a robot folder, a posture, a patch and options."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

from impedance_modules.backends.baxter.postures import named_posture
from impedance_modules.backends.baxter.simulator.options import FakeOptions
from impedance_modules.backends.baxter.simulator.served import served_description, write_description
from impedance_modules.backends.baxter.simulator.simulated_baxter import FakeBaxter
from impedance_modules.effects.apply import apply_patch, apply_to_plant
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.patch_file import PatchSpec
from impedance_modules.spec.robot_reader import read_robot


@dataclass(frozen=True)
class BuiltFake:
    """A double, and the description that it serves."""

    robot: FakeBaxter
    description: str


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
        spec = apply_patch(spec, patch)
    text = served_description(spec, options.mount_offset)
    with tempfile.TemporaryDirectory() as folder:
        model = RobotModel(replace(spec, urdf=write_description(text, Path(folder))))
        worn = None if patch is None else apply_to_plant(model, patch)
        return BuiltFake(FakeBaxter(model, worn, model.position(stands), options), text)
