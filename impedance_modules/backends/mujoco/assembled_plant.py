# SPDX-License-Identifier: BSD-3-Clause
"""A task's robot and surroundings put together in MuJoCo, from the robot's folder or from a model of one's own."""

from __future__ import annotations

from pathlib import Path

from impedance_modules.arrays import Array
from impedance_modules.backends.mujoco.mujoco_plant import MujocoPlant
from impedance_modules.backends.mujoco.scene import build_scene
from impedance_modules.backends.mujoco.surroundings import refuse_surfaces
from impedance_modules.backends.mujoco.worn_effects import worn_effects
from impedance_modules.plant.plant import PlantOptions
from impedance_modules.plant.rigid_object import ObjectBody
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.patch_file import PatchSpec
from impedance_modules.spec.task import TaskSpec


def mujoco_plant(
    model: RobotModel,
    task: TaskSpec,
    posture: Array,
    options: PlantOptions,
    *,
    patch: PatchSpec | None = None,
    mjcf: Path | None = None,
) -> MujocoPlant:
    """Builds a task's simulated robot on MuJoCo; ``reset`` or ``warm`` it before use.

    Args:
        model: Of the robot with the patch applied.
        task: With its surfaces and its object as they really are.
        posture: (n,) at the start [rad].
        options: Rate, seed and noise.
        patch: Effects that the robot has beyond its model; None for none.
        mjcf: Model of the same robot that MuJoCo shall have instead of the folder's; None for none.

    Raises:
        BadInput, BadFile: A surface, an effect or the model is nothing that MuJoCo can have.
    """
    refuse_surfaces(task)
    worn = worn_effects(model, patch)
    held = None if task.object is None else ObjectBody.of_task(model, task.object)
    scene = build_scene(model, task.environment, held, posture, worn.plant, mjcf)
    return MujocoPlant(model, scene, worn, options, task.pushes)
