# SPDX-License-Identifier: BSD-3-Clause
"""A shipped task carried out for an experiment: recorded, observed in every cycle, changed, or with pushes traced.

Assembly, safety and plant are those of ``impedance run``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.episode.data import Episode
from impedance_modules.episode.reader import read_episode
from impedance_modules.plant.ground_truth import OBJECT
from impedance_modules.plant.plant import Plant
from impedance_modules.plant.pushes import push_wrench
from impedance_modules.prediction.feasibility import refuse_infeasible
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import log3
from impedance_modules.robot.state import RobotState
from impedance_modules.runs.execution import RunOptions, RunResult, carry_out
from impedance_modules.runs.task_plant import sim_backend
from impedance_modules.spec.document import Document, scan_document
from impedance_modules.spec.locate import data_folder
from impedance_modules.spec.task import PushSpec
from impedance_modules.spec.task_reader import read_task
from impedance_modules.spec.task_text import changed, find_steps, task_document

Observer = Callable[[RobotState, Plant, Supervisor], None]
EVERY = 5
"""Control periods from one sample to the next."""


@dataclass(frozen=True)
class TaskRun:
    """A finished run with its recording."""

    assembly: Assembly
    result: RunResult
    episode: Episode


def record_task(task: str, out: Path, *, effects: Path | None = None, seed: int = 0) -> TaskRun:
    """Runs a task as ``impedance run TASK --out DIR --effects PATCH --seed N`` does, and reads its recording.

    Raises:
        BadInput: The task is refused.
    """
    assembly = assemble(task, effects=effects, rate=None, scale=1.0, arm=None)
    refuse_infeasible(assembly)
    options = RunOptions(out=out, seed=seed, duration=None, live=False, read_only=False, backend="sim")
    result = carry_out(assembly, sim_backend(assembly, seed), options, lambda _time, _phase: None)
    return TaskRun(assembly, result, read_episode(out))


def watch_task(assembly: Assembly, observe: Observer, *, seed: int = 0, noise: bool = True) -> Supervisor:
    """Runs a task without files and calls ``observe`` with the plant's true state once a cycle.

    Args:
        assembly: The task, checked by the caller where it need be.
        observe: Called with what the robot measured, the plant, and the supervisor.
        seed: Of the simulated noise.
        noise: Whether sensors are noisy.
    """
    supervisor = Supervisor(assembly)
    supervisor.controller.warm()
    backend = sim_backend(assembly, seed, noise=noise)
    first = backend.start()
    supervisor.start(first)
    run_loop(
        supervisor,
        backend,
        first.state,
        lambda state, _effort, _late, _asked: observe(state, backend.plant, supervisor),
        Interrupt(),
        duration=None,
        paced=False,
        read_only=False,
    )
    return supervisor


@dataclass(frozen=True)
class PushTrace:
    """Motion of a pushed body, N samples; true, not measured.

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
        """Marks the samples between two times [s]."""
        return np.asarray((self.time >= first) & (self.time < last))


def patch_of(task_name: str, patch: str) -> Path:
    """Returns the path of a patch that is shipped with the robot of a task."""
    task, _ = read_task(task_name)
    return data_folder("robots") / task.robot / "patches" / f"{patch}.yaml"


def only_arm(assembly: Assembly) -> str:
    """Returns the name of a task's first arm."""
    return next(iter(assembly.task.arms))


def frames_of(assembly: Assembly, arm: str) -> list[str]:
    """Names the frames that turn with an arm's joints, from the shoulder outwards, its hand last."""
    model, q = assembly.model, assembly.modules.posture
    limb, moved = model.limbs[arm], q.copy()
    moved[limb.joints] += 0.1
    turned = [
        f for f in model.frames if not np.allclose(model.pose(q, f).rotation, model.pose(moved, f).rotation)
    ]
    return [frame for frame in turned if frame != limb.hand] + [limb.hand]


def first_pushes(assembly: Assembly, count: int, settle: float) -> Assembly:
    """Keeps a task's first pushes, and its only phase until ``settle`` seconds after them."""
    task = assembly.task
    pushes = task.pushes[:count]
    end = max(push.start + push.rise + push.hold + push.fall for push in pushes) + settle
    phase = replace(task.phases[0], duration=end)
    return replace(assembly, task=replace(task, pushes=pushes, phases=(phase,)))


def trace_pushed(assembly: Assembly, target: str, *, seed: int, noise: bool) -> PushTrace:
    """Runs a task and records the motion of one body that it pushes.

    Args:
        assembly: The task.
        target: Limb whose hand is recorded, or ``object``.
        seed: Of the simulated noise.
        noise: Whether sensors are noisy.
    """
    model, pushes = assembly.model, assembly.task.pushes
    rows: list[tuple[float, Pose, Array, Array, Array]] = []
    count = 0

    def observe(_: RobotState, plant: Plant, __: Supervisor) -> None:
        nonlocal count
        count += 1
        if count % EVERY == 0:
            q = plant.position
            rows.append((plant.time, *_motion(plant, target, q), q, push_wrench(pushes, target, plant.time)))

    supervisor = watch_task(assembly, observe, seed=seed, noise=noise)
    start = rows[0][1]
    ending = "" if supervisor.ending is None else supervisor.ending.value
    return PushTrace(
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


def task_with(name: str, values: Mapping[str, Any], folder: Path, mark: str) -> Path:
    """Writes a task with values replaced, by their paths as in ``sweep --vary``; returns its file."""
    return _written(task_document(name), values, folder / f"{name}-{mark}.yaml")


def patch_with(patch: Path, values: Mapping[str, Any], folder: Path, mark: str) -> Path:
    """Does the same with a patch file."""
    return _written(scan_document(patch), values, folder / f"{patch.stem}-{mark}.yaml")


def _written(document: Document, values: Mapping[str, Any], path: Path) -> Path:
    changes = {find_steps(document.data, steps): value for steps, value in values.items()}
    path.write_text(changed(document, changes))
    return path
