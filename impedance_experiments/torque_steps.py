# SPDX-License-Identifier: BSD-3-Clause
"""Steps of torque against a torsion spring on a bench: the runs, the fit of the drive, and its diagnosis (3.2.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from impedance_experiments.drive_fit import DriveFit, fit_drive, fixture_of, links_inertia
from impedance_experiments.task_run import TaskRun, patch_of, patch_with, record_task, task_with
from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.nominal_model import model_of_spec
from impedance_modules.diagnosis.diagnose import diagnose
from impedance_modules.diagnosis.result import Diagnosis
from impedance_modules.effects.joint_motion import sign
from impedance_modules.spec.task_reader import read_task
from impedance_modules.spec.task_text import task_document

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
    spring = next(spec.parameters[joint] for spec in fixture_of(run) if joint in spec.parameters)
    friction = fit.values["asymmetric_friction"]
    inertia = fit.values["reflected_inertia"]["Ia"] + links_inertia(run, joint)
    damping = fit.values["viscous_friction"]["fv"] + spring["d"].value
    command = np.interp(episode.time - delay, episode.time, episode.effort_command[joint])
    angle, speed = np.empty_like(command), 0.0
    q = episode.position[joint][0]
    for k, step in enumerate(np.diff(episode.time, append=episode.time[-1])):
        angle[k] = q
        way = float(sign.python(np.array(speed)))
        dry = friction["fc"] * way + friction["da"] * abs(way) + friction["dv"] * abs(speed)
        elastic = spring["k"].value * (q - spring["q0"].value)
        speed += step * (command[k] - damping * speed - dry - elastic) / inertia
        q += step * speed
    return angle


def diagnose_steps(runs: Sequence[TaskRun], joint: str) -> Diagnosis:
    """Diagnoses the recordings with the test fixture known, but neither this rotor's inertia nor the friction."""
    robot = runs[0].assembly.robot
    limb = next(limb for limb in robot.limbs.values() if joint in limb.joints.values())
    drives = {**robot.joints, joint: replace(robot.joints[joint], reflected_inertia=0.0)}
    model = model_of_spec(replace(robot, joints=drives), list(limb.joints.values()))
    episodes = [
        replace(run.episode, metadata={**run.episode.metadata, "episode": run.episode.source.name})
        for run in runs
    ]
    return diagnose(episodes, model, robot.urdf, tolerance=0.0, known_effects=fixture_of(runs[0]))


def step_friction(run: TaskRun, joint: str) -> tuple[float, float]:
    """Gives fc and da of the dry friction that the run's patch puts on the joint [N.m]."""
    patch = run.assembly.patch
    for spec in () if patch is None else patch.effects:
        if spec.effect == "asymmetric_friction" and joint in spec.parameters:
            numbers = spec.parameters[joint]
            return numbers["fc"].value, numbers["da"].value
    return 0.0, 0.0
