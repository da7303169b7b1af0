# SPDX-License-Identifier: BSD-3-Clause
r"""Which effects of a patch the robot on MuJoCo has, as numbers of joints, drives or sensors; the others are refused.

    on a joint's link or rotor:  - F sgn(v) - D v - C v|v|,        on its link:  - k q + preload

What the model of the robot knows (inertia, series springs, a leaning base) is in the bodies already, and play in the
springs. Drives, delays and sensors are the built-in plant's, evaluated once per loop of the robot. What needs a law of
its own inside the physics is refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.mujoco.robot_bodies import RobotIndices
from impedance_modules.effects.apply import effects_of_patch
from impedance_modules.effects.drive_path import DrivePath
from impedance_modules.effects.effect import Effect, Values
from impedance_modules.effects.effect_description import Port
from impedance_modules.effects.plant_builder import PlantBuilder, PlantEffects
from impedance_modules.effects.simulator_numbers import Quantity
from impedance_modules.errors import BadFile, Problem
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.patch_file import PatchSpec

MOTOR, LINK = 0, 1
"""Sides of a joint: what acts on the motor's does not show in the torque between gear and link as a load."""

PLACES: Mapping[Quantity, str] = {
    "dry friction": "friction",
    "viscous friction": "damping",
    "drag": "drag",
    "joint spring": "spring",
}
"""Quantities that are numbers of MuJoCo's joints, and where ``JointNumbers`` holds them."""


class JointNumbers:
    """What effects add to MuJoCo's joints.

    Attributes:
        friction: (2, n) F of motor and link side [N.m].
        damping: (2, n) D [N.m.s/rad].
        drag: (2, n) C [N.m.s^2/rad^2].
        spring: (2, n) k [N.m/rad] and preload [N.m], on the links.
    """

    def __init__(self, n: int) -> None:
        self.friction: Array = np.zeros((2, n))
        self.damping: Array = np.zeros((2, n))
        self.drag: Array = np.zeros((2, n))
        self.spring: Array = np.zeros((2, n))

    def add(self, quantity: Quantity, side: int, joint: int, numbers: Array) -> None:
        """Adds one amount of ``effects/simulator_numbers.py``."""
        place = getattr(self, PLACES[quantity])
        if quantity == "joint spring":
            place[:, joint] += numbers
        else:
            place[side, joint] += numbers[0]

    def write(self, compiled: mujoco.MjModel, at: RobotIndices) -> None:
        """Adds them to a compiled model; the springs' preload is a torque that whoever steps it applies."""
        for side, dof in ((MOTOR, at.motor_velocity), (LINK, at.velocity)):
            compiled.dof_damping[dof] += self.damping[side]
            compiled.dof_dampingpoly[dof, 0] += self.drag[side]
            compiled.dof_frictionloss[dof] += self.friction[side]
        compiled.jnt_stiffness[compiled.dof_jntid[at.velocity]] += self.spring[0]


@dataclass(frozen=True)
class WornEffects:
    """A patch on MuJoCo's robot.

    Attributes:
        plant: Sensors, delay, gains, gravity's turn and the springs that the robot itself compensates.
        drive: Path from the torque asked for to the motor's; None where nothing happens on it.
        joints: Numbers of the joints.
    """

    plant: PlantEffects
    drive: DrivePath | None
    joints: JointNumbers


def worn_effects(model: RobotModel, patch: PatchSpec | None) -> WornEffects:
    """Sorts a checked patch into what MuJoCo's robot has.

    Args:
        model: Of the robot with the patch applied (``effects.apply.apply_patch``).
        patch: None for no effect.

    Raises:
        BadFile: Every effect that it cannot have, with its line, the reason, and what has it.
    """
    builder, joints = PlantBuilder(model), JointNumbers(model.n)
    problems: list[Problem] = []
    for index, (effect, port, parameters) in enumerate(effects_of_patch(patch) if patch else ()):
        if patch is not None and not _wear(model, builder, joints, (effect, port, parameters)):
            problems.append(_refused(patch, index, effect))
    if problems:
        raise BadFile(problems)
    plant = builder.finish()
    drive = next((torque for torque in plant.torques if isinstance(torque, DrivePath)), None)
    return WornEffects(plant, drive, joints)


def _wear(
    model: RobotModel,
    builder: PlantBuilder,
    joints: JointNumbers,
    found: tuple[Effect, Port, Mapping[str, Values]],
) -> bool:
    """Takes one effect up; says whether all of it could be."""
    effect, port, parameters = found
    alone = PlantBuilder(model)
    effect.apply_to_plant(alone, port, parameters)
    if alone.coupling.any() or alone.added_mass.any():
        return False
    if alone.torques:
        amounts = list(_amounts(effect, port, parameters))
        if not amounts or any(quantity not in PLACES for quantity, _, _ in amounts):
            return False
        side = MOTOR if port == "actuator" else LINK
        for quantity, joint, numbers in amounts:
            joints.add(quantity, side, model.joint_names.index(joint), numbers)
    before = len(builder.torques)
    effect.apply_to_plant(builder, port, parameters)
    del builder.torques[before:]
    return True


def _amounts(
    effect: Effect, port: Port, parameters: Mapping[str, Values]
) -> Iterator[tuple[Quantity, str, Array]]:
    for part in effect.exported:
        for key, values in parameters.items():
            numbers = np.asarray(part.numbers(values), dtype=float)
            if part.acts_at(port) and numbers.size:
                yield part.quantity, key, numbers


def _refused(patch: PatchSpec, index: int, effect: Effect) -> Problem:
    message = (
        f"'{effect.id}' is nothing that MuJoCo has: {effect.not_exported}"
        " (valid: --backend sim, whose built-in plant has it)"
    )
    return patch.document.problem(("effects", index, "effect"), message)
