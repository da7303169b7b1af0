# SPDX-License-Identifier: BSD-3-Clause
"""Tasks in which somebody pushes: the plant's truth while they run, and as much of them as a size asks for."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_experiments.task_run import watch_task
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.plant.plant import Plant
from impedance_modules.plant.pushes import push_wrench
from impedance_modules.plant.ground_truth import OBJECT
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import log3
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.locate import data_folder
from impedance_modules.spec.task import PushSpec
from impedance_modules.spec.task_reader import read_task

Array = NDArray[np.float64]

EVERY = 5
"""Control periods from one look to the next."""


@dataclass(frozen=True)
class Trace:
    """Motion of a pushed body, N looks; true, not sensed.

    Attributes:
        time: (N,) since the start [s].
        place: (N, 6) displacement from the start: of the origin [m], rotation vector in world axes [rad].
        twist: (N, 6) world axes [m/s], [rad/s].
        q: (N, n) joints [rad].
        push: (N, 6) what pushes it [N, N.m].
        ending: How the run ended, and why.
    """

    time: Array
    place: Array
    twist: Array
    q: Array
    push: Array
    ending: str

    def over(self, first: float, last: float) -> NDArray[np.bool_]:
        """Marks the looks between two times [s]."""
        return np.asarray((self.time >= first) & (self.time < last))


def patch_of(task_name: str, patch: str) -> Path:
    """Finds a patch that is shipped with the robot of a task."""
    task, _ = read_task(task_name)
    return data_folder("robots") / task.robot / "patches" / f"{patch}.yaml"


def only_arm(assembly: Assembly) -> str:
    """Names a task's first arm."""
    return next(iter(assembly.task.arms))


def first_pushes(assembly: Assembly, count: int, settle: float) -> Assembly:
    """Keeps a task's first pushes, and its only phase until ``settle`` seconds after them."""
    task = assembly.task
    pushes = task.pushes[:count]
    end = max(push.start + push.rise + push.hold + push.fall for push in pushes) + settle
    phase = replace(task.phases[0], duration=end)
    return replace(assembly, task=replace(task, pushes=pushes, phases=(phase,)))


def trace_pushed(assembly: Assembly, target: str, *, seed: int, noise: bool) -> Trace:
    """Runs a task and follows one body that it pushes.

    Args:
        assembly: The task.
        target: Limb whose hand is followed, or ``object``.
        seed: Of the simulated noise.
        noise: Whether sensors are noisy.
    """
    model, pushes = assembly.model, assembly.task.pushes
    rows: list[tuple[float, Pose, Array, Array, Array]] = []
    count = 0

    def look(_: RobotState, plant: Plant, __: Supervisor) -> None:
        nonlocal count
        count += 1
        if count % EVERY == 0:
            q = plant.position
            rows.append((plant.time, *_motion(plant, target, q), q, push_wrench(pushes, target, plant.time)))

    supervisor = watch_task(assembly, look, seed=seed, noise=noise)
    start = rows[0][1]
    ending = "" if supervisor.ending is None else supervisor.ending.value
    return Trace(
        time=np.array([row[0] for row in rows]),
        place=np.array([displacement(start, row[1]) for row in rows]),
        twist=np.array([row[2] for row in rows]),
        q=np.array([row[3] for row in rows]).reshape(-1, model.n),
        push=np.array([row[4] for row in rows]),
        ending=f"{ending} {supervisor.reason}".strip(),
    )


def _motion(plant: Plant, target: str, q: Array) -> tuple[Pose, Array]:
    """Gives pose and twist (6,) of the object, or of a limb's hand."""
    pose, twist = plant.object_pose, plant.object_twist
    if target == OBJECT and pose is not None and twist is not None:
        return pose, twist
    hand = plant.model.limbs[target].hand
    return plant.model.pose(q, hand), plant.hand_twist(hand)


def displacement(start: Pose, now: Pose) -> Array:
    """Gives how far a body has moved, (6,): its origin [m], and its rotation vector in world axes [rad]."""
    turn = log3(now.rotation @ start.rotation.T)
    return np.concatenate([now.translation - start.translation, turn])


def full_strength(push: PushSpec, last: float) -> tuple[float, float]:
    """Gives the last ``last`` seconds of a push at full strength, (first, last) [s]."""
    end = push.start + push.rise + push.hold
    return end - last, end
