# SPDX-License-Identifier: BSD-3-Clause
"""Torque steps on a joint against a real torsion spring: inertia, damping, directional friction (thesis 3.2.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_experiments.drive_fit import DriveFit, bench_of, fit_drive
from impedance_experiments.pushing import patch_of
from impedance_experiments.struck_joint import links_inertia
from impedance_experiments.task_run import TaskRun, record_task
from impedance_experiments.variants import patch_with, task_with
from impedance_modules.diagnosis.diagnose import diagnose
from impedance_modules.diagnosis.data.nominal_model import model_of_spec
from impedance_modules.diagnosis.result import Diagnosis
from impedance_modules.effects.joint_motion import sign
from impedance_modules.spec.task_text import task_document
from impedance_modules.spec.task_reader import read_task

Array = NDArray[np.float64]

STEP_TASK, STEP_PATCH = "torque-steps", "torsion-spring"
LAWS = ("reflected_inertia", "viscous_friction", "asymmetric_friction")
SPRING = "effects.1.parameters.{}.k.value"
"""Where the patch has the torsion spring's stiffness."""


@dataclass(frozen=True)
class StepsFit:
    """One spring.

    Attributes:
        stiffness: Of the torsion spring [N.m/rad].
        fit: Of the drive's torque.
        accounted: Share of the angle's variance that the second-order model accounts for, driven by the command alone.
        time, angle, fitted: (N,) the joint's angle, and the model's [s], [rad].
    """

    stiffness: float
    fit: DriveFit
    accounted: float
    time: Array
    angle: Array
    fitted: Array


def stepped_joint() -> str:
    """Names the joint whose rest the task's phases move."""
    task, robot = read_task(STEP_TASK)
    limb, rests = next(item for phase in task.phases for item in phase.posture.items())
    return robot.limbs[limb].joints[next(iter(rests))]


def step_against(
    stiffness: float, joint: str, folder: Path, *, seed: int, phases: int | None = None
) -> TaskRun:
    """Runs the task against another torsion spring, or only its first phases."""
    patch = patch_with(
        patch_of(STEP_TASK, STEP_PATCH), {SPRING.format(joint): stiffness}, folder, f"{stiffness:g}"
    )
    task = STEP_TASK
    if phases is not None:
        first = task_document(STEP_TASK).data["phases"][:phases]
        task = str(task_with(STEP_TASK, {"phases": first}, folder, f"first-{phases}"))
    return record_task(task, folder / f"{STEP_TASK}-{stiffness:g}-{seed}", effects=patch, seed=seed)


def step_down(stiffness: float, joint: str, folder: Path, *, seed: int) -> TaskRun:
    """Runs the task with all steps the other way, 0.9 times as large."""
    patch = patch_with(
        patch_of(STEP_TASK, STEP_PATCH), {SPRING.format(joint): stiffness}, folder, f"{stiffness:g}"
    )
    values = {}
    for place, phase in enumerate(task_document(STEP_TASK).data["phases"]):
        for limb, rests in phase.get("posture", {}).items():
            for short, rest in rests.items():
                start = task_document(STEP_TASK).data["arms"][limb]["posture"][short]
                values[f"phases.{place}.posture.{limb}.{short}"] = start - 0.9 * (rest - start)
    task = task_with(STEP_TASK, values, folder, "down")
    return record_task(str(task), folder / f"{STEP_TASK}-down", effects=patch, seed=seed)


def read_steps(run: TaskRun, joint: str, stiffness: float) -> StepsFit:
    """Fits the drive, and lets the second-order model with the fitted numbers follow the recorded command."""
    fit = fit_drive([run], joint, LAWS)
    time, angle = run.episode.time, run.episode.position[joint]
    fitted = _second_order(run, joint, fit)
    accounted = 1.0 - float(np.var(angle - fitted) / np.var(angle))
    return StepsFit(stiffness, fit, accounted, time, angle, fitted)


def _second_order(run: TaskRun, joint: str, fit: DriveFit) -> Array:
    r"""Integrates (I_r + M) \ddot q + (D + d) \dot q + friction + k (q - q_0) = u, links and rotor as one."""
    episode, delay = run.episode, run.assembly.robot.timing.command_delay
    spring = next(spec.parameters[joint] for spec in bench_of(run) if joint in spec.parameters)
    friction = fit.values["asymmetric_friction"]
    inertia = fit.values["reflected_inertia"]["Ia"] + links_inertia(run, joint)
    damping = fit.values["viscous_friction"]["fv"] + spring["d"].value
    command = np.interp(episode.time - delay, episode.time, episode.effort_command[joint])
    angle, speed = np.empty_like(command), 0.0
    q = episode.position[joint][0]
    for k, step in enumerate(np.diff(episode.time, append=episode.time[-1])):
        angle[k] = q
        way = float(sign(np.array(speed)))
        dry = friction["fc"] * way + friction["da"] * abs(way) + friction["dv"] * abs(speed)
        elastic = spring["k"].value * (q - spring["q0"].value)
        speed += step * (command[k] - damping * speed - dry - elastic) / inertia
        q += step * speed
    return angle


def diagnose_steps(runs: Sequence[TaskRun], joint: str) -> Diagnosis:
    """Asks the diagnosis, which knows the bench but neither this rotor's inertia nor the friction, what the gap is."""
    robot = runs[0].assembly.robot
    limb = next(limb for limb in robot.limbs.values() if joint in limb.joints.values())
    drives = {**robot.joints, joint: replace(robot.joints[joint], reflected_inertia=0.0)}
    model = model_of_spec(replace(robot, joints=drives), list(limb.joints.values()))
    episodes = [
        replace(run.episode, metadata={**run.episode.metadata, "episode": run.episode.source.name})
        for run in runs
    ]
    return diagnose(episodes, model, robot.urdf, worn=bench_of(runs[0]))
