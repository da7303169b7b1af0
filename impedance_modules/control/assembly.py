# SPDX-License-Identifier: BSD-3-Clause
"""Everything a run needs, resolved before anything moves: task, robot with a patch applied, modules, limits, tank."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.control.adjust import as_taught, scaled, single_arm
from impedance_modules.control.recorded_paths import Kept, with_recorded_paths
from impedance_modules.effects.apply import apply_patch, apply_to_object, apply_to_surfaces
from impedance_modules.effects.compensate import PatchCompensation, compensate_patch
from impedance_modules.errors import BadInput
from impedance_modules.modules.arms import TaskModules, build_modules
from impedance_modules.modules.own_module import OwnModule
from impedance_modules.robot.distances import Distances
from impedance_modules.robot.hand_postures import with_joint_angles
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.safety.brake import BrakeGains, brake_gains, trusted_motor_damping
from impedance_modules.safety.limits import FilterLimits, braking_deceleration, limits_of
from impedance_modules.safety.motor_port import sensing_deviation, sensing_error, spring_compliances
from impedance_modules.safety.tank_settings import TankSettings
from impedance_modules.spec.patch_file import PatchSpec, read_patch
from impedance_modules.spec.robot_spec import RobotSpec
from impedance_modules.spec.task import ObjectSpec, TaskSpec
from impedance_modules.spec.task_reader import read_task

RECOVERY_TIME = 0.5
"""Time constant with which relaxed springs are tightened again [s]."""

SAMPLED_POSTURES = 64
"""Postures at which the largest joint inertia is looked for, from a fixed seed."""


@dataclass(frozen=True)
class Assembly:
    """A task ready to run.

    Attributes:
        task: As it will run, scale and arm applied.
        held: The task's object as it really is, for the plant alone: the controller knows the task's; None without one.
        robot: With the effects of the patch applied.
        patch: The patch, or None.
        compensation: Of what was diagnosed, or None.
        model: Of that robot.
        weighed: The same with the weights of what is compensated: what measured torques are compared with.
        modules: Built at the start posture.
        rate: Control rate [Hz].
        scale: As asked for.
        arm: The only arm that takes part, or None for all.
        tank: Constants of the energy ledger.
        limits: Constants of the filter.
        own: Modules that somebody wrote in Python; predictions do not know them.
        allow_unstable: Whether it may run although a loop is predicted to be unstable: simulated experiments.
    """

    task: TaskSpec
    robot: RobotSpec
    patch: PatchSpec | None
    model: RobotModel
    weighed: RobotModel
    modules: TaskModules
    rate: float
    scale: float
    arm: str | None
    tank: TankSettings
    limits: FilterLimits
    brake: BrakeGains
    compensation: PatchCompensation | None = None
    own: tuple[OwnModule, ...] = ()
    allow_unstable: bool = False
    held: ObjectSpec | None = None

    @property
    def period(self) -> float:
        """Control period [s]."""
        return 1.0 / self.rate


def assemble(
    task_name: str,
    *,
    effects: Path | None,
    rate: float | None,
    scale: float,
    arm: str | None,
    compensate: Path | None = None,
    calibrate: Callable[[RobotSpec], RobotSpec] | None = None,
    robot_name: str | None = None,
    paths: Kept | None = None,
) -> Assembly:
    """Reads and checks a task and everything it names.

    Args:
        task_name: Path or shipped name.
        effects: Patch file whose effects are applied to plant and model, or None.
        rate: Control rate [Hz], or None for the robot's own.
        scale: Multiplies stiffness, damping and forces.
        arm: Only this arm takes part, or None for all.
        compensate: Patch file whose effects the controller compensates, or None.
        calibrate: Replaces the robot by one particular one, e.g. with its own mounts; None leaves the folder's.
        robot_name: Name or folder of the robot that the task runs on; None for the one that it names.
        paths: Paths of targets that a recording of the task carries; None reads them from the files that it names.

    Raises:
        BadInput, BadFile: Every problem of the input; nothing has moved.
    """
    task, robot = read_task(task_name, robot=robot_name)
    if calibrate is not None:
        robot = calibrate(robot)
    task = with_joint_angles(task, robot)
    compensation = None if compensate is None else _compensation(task, robot, compensate)
    patch = None if effects is None else read_patch(effects)
    if patch is not None:
        robot = apply_patch(robot, patch)
        task = replace(task, environment=apply_to_surfaces(task.environment, patch))
    task = scaled(task, scale)
    if arm is not None:
        task = single_arm(task, arm)
    used_rate = _checked_rate(robot, rate)
    model = RobotModel(robot)
    task = with_recorded_paths(task, model, paths)
    modules = build_modules(task, model)
    inertia = largest_inertia(model, modules.posture)
    return Assembly(
        task=task,
        robot=robot,
        patch=patch,
        model=model,
        weighed=_weighed(model, compensation),
        modules=modules,
        rate=used_rate,
        scale=scale,
        arm=arm,
        tank=_tank_settings(task, model, used_rate, compensation),
        limits=_filter_limits(model, inertia, used_rate),
        brake=_brake_gains(model, inertia, used_rate),
        compensation=compensation,
        held=task.object if patch is None else apply_to_object(task.object, patch),
    )


def taught(assembly: Assembly) -> Assembly:
    """Returns a task to be played back as its springs teach it; any other as it is."""
    return assembly if assembly.task.playback is None else replace(assembly, task=as_taught(assembly.task))


def make_distances(assembly: Assembly, kinematics: Kinematics) -> Distances:
    """Prepares to measure the distances of the robot's pairs of links.

    Raises:
        BadInput: A link's shape is not there or cannot be read.
    """
    limits = assembly.limits
    return Distances(
        kinematics,
        assembly.robot.collision.pairs,
        margin=limits.margin,
        approach_time=limits.approach_time,
        horizon=limits.pair_horizon,
        period=assembly.period,
    )


def _compensation(task: TaskSpec, robot: RobotSpec, path: Path) -> PatchCompensation:
    if task.playback is not None:
        raise BadInput(
            f"--compensate: task '{task.name}' plays a joint path back in the robot's own position mode, to which no"
            " torque is added (valid: a task without 'playback')"
        )
    return compensate_patch(robot, read_patch(path))


def _checked_rate(robot: RobotSpec, rate: float | None) -> float:
    timing = robot.timing
    used = timing.rate if rate is None else rate
    if not timing.rate_min <= used <= timing.rate_max:
        raise BadInput(
            f"--rate {used:g} Hz: robot '{robot.name}' runs from {timing.rate_min:g} to {timing.rate_max:g} Hz"
        )
    return used


def delay_periods(robot: RobotSpec, rate: float) -> int:
    """Counts the whole control periods a command waits before it acts (the robot latches at its samples)."""
    return math.ceil(robot.timing.command_delay * rate - 1e-9)


def _weighed(model: RobotModel, compensation: PatchCompensation | None) -> RobotModel:
    believed = None if compensation is None else compensation.numbers.robot
    if believed is None:
        return model
    return RobotModel(replace(model.spec, body_changes=believed.body_changes, gravity=believed.gravity))


def _tank_settings(
    task: TaskSpec, model: RobotModel, rate: float, compensation: PatchCompensation | None
) -> TankSettings:
    compliance = spring_compliances(model.joints)
    speed = model.column("velocity_max")
    return TankSettings(
        initial=task.tank.initial,
        max=task.tank.max,
        floor=task.tank.floor,
        period=1.0 / rate,
        delay=delay_periods(model.spec, rate),
        hold=1.0 / rate,
        speed_bound=speed,
        compliance=compliance,
        sensing_error=sensing_error(model.spec.sensors, compliance, speed, 0.0),
        sensing_deviation=sensing_deviation(model.spec.sensors, compliance),
        recovery_time=RECOVERY_TIME,
        least_gain=None if compensation is None else compensation.numbers.least_gain,
        most_gain=None if compensation is None else compensation.numbers.most_gain,
    )


def _filter_limits(model: RobotModel, inertia: Array, rate: float) -> FilterLimits:
    return limits_of(
        model.joints,
        model.spec.timing,
        rate=rate,
        reflected_inertia=model.reflected_inertia,
        deceleration=braking_deceleration(model.column("effort_max"), inertia),
        margin=model.spec.collision.margin,
    )


def _brake_gains(model: RobotModel, inertia: Array, rate: float) -> BrakeGains:
    damping = trusted_motor_damping(model.motor_damping, model.reflected_inertia)
    return brake_gains(damping, inertia, 1.0 / rate, delay_periods(model.spec, rate))


def largest_inertia(model: RobotModel, posture: Array) -> Array:
    """Finds the largest diagonal of M + I_r over the start posture and sampled ones, (n,) [kg.m^2]."""
    random = np.random.default_rng(0)
    low, high = model.column("position_min"), model.column("position_max")
    postures = [posture, *random.uniform(low, high, (SAMPLED_POSTURES, model.n))]
    return np.asarray(np.max([np.diag(model.mass_matrix(q)) for q in postures], axis=0))
