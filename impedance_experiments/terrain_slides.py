# SPDX-License-Identifier: BSD-3-Clause
"""One slide over a surface, by springs or by the robot's own playback, and what really happened in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_experiments.parallel_runs import carry_out_all
from impedance_experiments.task_run import watch_task
from impedance_experiments.thesis_page import Settings
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.plant.plant import Plant
from impedance_modules.plant.playback import JointPath
from impedance_modules.robot.state import RobotState
from impedance_modules.runs.playback_run import make_playback
from impedance_modules.spec.robot_spec import PlaybackSpec
from impedance_modules.spec.task import SurfaceSpec

LEANT = 6.0
"""The hand leans on the surface from here on: phases lower and lean are over [s]."""

EVERY = 10
"""One in so many milliseconds is kept."""

LEAST_CONTACT_FORCE = 0.1
"""A hand that a surface presses with less is not in contact [N]."""


@dataclass(frozen=True)
class SlideJob:
    """A slide to be made.

    Attributes:
        task: Its name.
        surfaces: What is there; None takes the task's environment.
        path: Played back by the robot; None lets the springs carry the task out.
        phases: How many of the task's phases are carried out.
        playback: How the robot plays back; None takes the robot file's.
        tank: Energy to begin with [J]; None takes the task's.
        effects: A patch applied to the plant; None for none.
        seed: Of the noise.
    """

    task: str
    surfaces: tuple[SurfaceSpec, ...] | None = None
    path: JointPath | None = None
    phases: int = 5
    playback: PlaybackSpec | None = None
    tank: float | None = None
    effects: Path | None = None
    seed: int = 0


@dataclass(frozen=True)
class Slide:
    """What really happened, sampled every 10 ms.

    Attributes:
        time: (N,) [s].
        place: (N, 3) of the hand in world [m].
        force: (N, 3) of the surfaces on the hand [N].
        away: (N,) of the joint furthest from its path [rad]; zero where nothing is played.
        path: (N, n) measured joint positions [rad].
        stopped: Why it ended early; empty where it did not.
        collisions: (time, kind) of the robot's pauses.
    """

    time: Array
    place: Array
    force: Array
    away: Array
    path: Array
    stopped: str
    collisions: tuple[tuple[float, str], ...]

    @property
    def sliding(self) -> NDArray[np.bool_]:
        """Samples after the hand has leant on the surface."""
        return np.asarray(self.time >= LEANT)

    @property
    def contact(self) -> float:
        """Share of the slide in which the surface presses the hand."""
        pressed = np.linalg.norm(self.force[self.sliding], axis=1) > LEAST_CONTACT_FORCE
        return float(pressed.mean()) if pressed.size else 0.0

    @property
    def peak(self) -> float:
        """Largest force on the hand [N]."""
        return float(np.linalg.norm(self.force, axis=1).max())

    def joint_path(self) -> JointPath:
        """Returns what the joints did as a path."""
        return JointPath(self.time - self.time[0], self.path)


def deviation_along_y(flat: Slide, other: Slide) -> float:
    """Returns the RMS of y(other) - y(flat) at equal times of the slide, as long as both last [m]."""
    last = min(flat.time[-1], other.time[-1])
    when = flat.time[(flat.time >= LEANT) & (flat.time <= last + 1e-9)]
    ours = np.interp(when, other.time, other.place[:, 1])
    return float(np.sqrt(np.mean((ours - np.interp(when, flat.time, flat.place[:, 1])) ** 2)))


def slide(job: SlideJob) -> Slide:
    """Makes one slide."""
    assembly = assemble(job.task, effects=job.effects, rate=None, scale=1.0, arm=None)
    task = replace(assembly.task, phases=assembly.task.phases[: job.phases])
    if job.surfaces is not None:
        task = replace(task, environment=job.surfaces)
    tank = assembly.tank
    if job.tank is not None:
        tank = replace(tank, initial=job.tank, max=max(job.tank, tank.max))
    assembly = replace(assembly, task=task, tank=tank)
    return _led_by_springs(assembly, job) if job.path is None else _played_back(assembly, job, job.path)


def _led_by_springs(assembly: Assembly, job: SlideJob) -> Slide:
    rows: list[Array] = []
    hand, ticks = assembly.modules.arms[0].limb.hand, 0

    def observe(state: RobotState, plant: Plant, _: Supervisor) -> None:
        nonlocal ticks
        if ticks % EVERY == 0:
            rows.append(_row(state, plant, hand, 0.0))
        ticks += 1

    supervisor = watch_task(assembly, observe, seed=job.seed)
    return _slide(rows, "" if supervisor.reason is None else supervisor.reason, ())


def _played_back(assembly: Assembly, job: SlideJob, path: JointPath) -> Slide:
    if job.playback is not None:
        model = assembly.model
        model.spec = replace(model.spec, playback=job.playback)
    playback = make_playback(assembly, path, job.seed)
    hand, ticks, rows = assembly.modules.arms[0].limb.hand, 0, []
    state = playback.start()
    while not playback.done:
        if ticks % EVERY == 0:
            away = float(np.abs(playback.wanted - state.position).max())
            rows.append(_row(state, playback.plant, hand, away))
        state = playback.tick()
        ticks += 1
    return _slide(rows, playback.stopped, tuple((time, kind) for time, _, kind in playback.collisions))


def _row(state: RobotState, plant: Plant, hand: str, away: float) -> Array:
    place, force = plant.pose(hand).translation, plant.contact_wrench(hand)[:3]
    return np.concatenate([[state.time], place, force, [away], state.position])


def _slide(rows: Sequence[Array], stopped: str, collisions: tuple[tuple[float, str], ...]) -> Slide:
    table = np.array(rows)
    return Slide(table[:, 0], table[:, 1:4], table[:, 4:7], table[:, 7], table[:, 8:], stopped, collisions)


def slide_all(
    jobs: Sequence[SlideJob], settings: Settings, share: tuple[float, float], doing: str
) -> list[Slide]:
    """Makes many slides side by side; results in order.

    Args:
        jobs: What to do.
        settings: Of the experiment; its folder keeps the slides.
        share: Of the experiment that is done before and after them, for its progress.
        doing: What to say meanwhile.
    """
    first, last = share

    def on_done(count: int) -> None:
        settings.on_progress(first + (last - first) * count / len(jobs), doing)

    return carry_out_all(slide, jobs, settings.work, on_done)
