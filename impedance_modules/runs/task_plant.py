# SPDX-License-Identifier: BSD-3-Clause
"""The built-in plant of a task with its surroundings: under torques, or under the robot's own modes in a playback."""

from __future__ import annotations

from impedance_modules.backends.sim_backend import SimBackend
from impedance_modules.backends.sim_grippers import SimulatedGrippers
from impedance_modules.control.assembly import Assembly
from impedance_modules.effects.apply import apply_to_plant
from impedance_modules.plant.joint_servos import DrivenPlant
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.plant.playback import TICK
from impedance_modules.plant.rigid_object import ObjectBody


def sim_backend(assembly: Assembly, seed: int, *, noise: bool = True) -> SimBackend[Plant]:
    """Builds the plant with the task's surroundings behind a backend."""
    task, model = assembly.task, assembly.model
    held = None if assembly.held is None else ObjectBody.of_task(model, assembly.held)
    options = PlantOptions(rate=assembly.rate, seed=seed, noise=noise)
    applied = None if assembly.patch is None else apply_to_plant(model, assembly.patch)
    plant = Plant(model, task.environment, held, options, applied, pushes=task.pushes)
    grippers = SimulatedGrippers(assembly.robot.limbs, task.object)
    return SimBackend(plant, assembly.modules.posture, assembly.period, grippers)


def playback_plant(assembly: Assembly, seed: int, *, noise: bool = True) -> DrivenPlant:
    """Builds the plant of a playback in the task's surroundings; not yet reset."""
    applied = None if assembly.patch is None else apply_to_plant(assembly.model, assembly.patch)
    options = PlantOptions(rate=1.0 / TICK, seed=seed, noise=noise)
    return DrivenPlant(assembly.model, options, applied, {}, assembly.task.environment)
