# SPDX-License-Identifier: BSD-3-Clause
"""The backend of a run: the built-in plant, MuJoCo, a recording that is fed back, or the real robot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.baxter.baxter_backend import BaxterBackend, DriveOptions
from impedance_modules.backends.baxter.robot_link import RobotLink
from impedance_modules.backends.baxter.session import Session
from impedance_modules.backends.preflight import PreflightResult
from impedance_modules.backends.protocol import Backend
from impedance_modules.backends.replay_backend import ReplayBackend
from impedance_modules.backends.sim_backend import SimBackend
from impedance_modules.backends.sim_grippers import SimulatedGrippers
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.contact_detection import contact_checks
from impedance_modules.control.gripper_watch import ordered_grippers
from impedance_modules.episode.data import Episode
from impedance_modules.episode.reader import read_episode
from impedance_modules.errors import BadInput
from impedance_modules.extras import need
from impedance_modules.installed import BACKENDS, installed, loaded
from impedance_modules.plant.plant import PlantOptions
from impedance_modules.runs.task_plant import sim_backend

if TYPE_CHECKING:
    from impedance_modules.backends.mujoco.mujoco_plant import MujocoPlant


def mujoco_backend(
    assembly: Assembly, seed: int, *, mjcf: Path | None = None, noise: bool = True
) -> SimBackend[MujocoPlant]:
    """Builds the task's scene in MuJoCo behind a backend.

    Args:
        assembly: The task.
        seed: Of the sensors' noise.
        mjcf: Model of the same robot that MuJoCo shall have instead of the folder's; None for none.
        noise: Whether there is any.

    Raises:
        BadInput, BadFile: MuJoCo is not installed, or a surface, an effect or the model is nothing it can have.
    """
    need("mujoco", "--backend mujoco")
    from impedance_modules.backends.mujoco.assembled_plant import mujoco_plant  # noqa: PLC0415 - an extra

    task, modules = assembly.task, assembly.modules
    plant = mujoco_plant(
        assembly.model,
        replace(task, object=assembly.held),
        modules.posture,
        PlantOptions(rate=assembly.rate, seed=seed, noise=noise),
        patch=assembly.patch,
        mjcf=mjcf,
    )
    grippers = SimulatedGrippers(assembly.robot.limbs, task.object)
    return SimBackend(plant, modules.posture, assembly.period, grippers)


def replay_backend(assembly: Assembly, log: Path) -> ReplayBackend:
    """Opens a recording as a robot.

    Raises:
        BadInput: It cannot be read, or lacks a joint's position, velocity or effort.
    """
    episode = read_episode(log)
    return ReplayBackend(episode, assembly.model.joint_names, acting_in(episode, assembly.model.n))


def acting_in(episode: Episode, n: int) -> Array:
    """Returns the torque (n,) that acted when a recording began [N.m]; zero where it does not say.

    Raises:
        BadInput: It says so of another number of joints.
    """
    acting = np.array(episode.metadata.get("acting", [0.0] * n), dtype=float)
    if acting.shape != (n,):
        raise BadInput(
            f"{episode.source}: metadata 'acting' has {acting.size} torques (valid: {n}, one per joint)"
        )
    return acting


def make_backend(
    assembly: Assembly, *, backend: str, log: Path | None, seed: int, mjcf: Path | None = None
) -> Backend:
    """Makes the robot of an assembled task, not yet started.

    Raises:
        BadInput: The recording is missing or unfit; nothing has moved.
    """
    if backend == "sim":
        return sim_backend(assembly, seed)
    if backend == "mujoco":
        return mujoco_backend(assembly, seed, mjcf=mjcf)
    if backend in installed(BACKENDS):
        made: Backend = loaded(BACKENDS, backend)(assembly, seed)
        return made
    if log is None:
        raise BadInput("--backend replay needs --log DIR, the recording to feed back")
    return replay_backend(assembly, log)


def baxter_backend(assembly: Assembly, session: Session, *, read_only: bool, approach: bool) -> BaxterBackend:
    """Makes the backend of a real robot, not yet started; sends nothing.

    Args:
        assembly: With the robot as ``session`` found it.
        session: Open.
        read_only: Nothing will be sent.
        approach: The robot's position mode may bring the arms to where the task begins.

    Raises:
        RobotRefused: The robot must not be moved now; with every reason and its remedy.
    """
    limbs = {arm.limb.name: arm.limb for arm in assembly.modules.arms}
    options = DriveOptions(
        assembly.rate, read_only, approach, assembly.modules.posture, ordered_grippers(assembly.task)
    )

    def of_task(link: RobotLink) -> tuple[PreflightResult, ...]:
        return () if link.sample is None else contact_checks(assembly, link.sample.state)

    return session.backend(limbs, options, assembly.model, of_task)
