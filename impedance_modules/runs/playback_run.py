# SPDX-License-Identifier: BSD-3-Clause
"""A task that the robot itself plays back: teach the path, play it, record, summarise.

The springs lead the arm over the surfaces of the map once (``teach``); what the joints did is the path. The robot's own
position or velocity mode then plays it in the surroundings as they are. Filter and tank take no part in that, so it
is done on the built-in plant only.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from impedance_modules.control.assembly import Assembly, taught
from impedance_modules.control.contact_detection import HandWrenches
from impedance_modules.control.loop import Interrupt
from impedance_modules.control.supervisor import Ending
from impedance_modules.episode.columns import joint_columns, pose_columns, wrench_columns
from impedance_modules.episode.metadata import episode_metadata, library_versions
from impedance_modules.episode.reader import read_episode
from impedance_modules.episode.run_folder import write_summary
from impedance_modules.episode.writer import EpisodeWriter
from impedance_modules.errors import BadInput, PlantNotFinite
from impedance_modules.plant.playback import TICK, JointPath, Playback, PlaybackMode
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.state import RobotState
from impedance_modules.runs.execution import RunOptions, carry_out, draw_run
from impedance_modules.runs.recorder import write_poses
from impedance_modules.runs.task_plant import playback_plant, sim_backend
from impedance_modules.spec.task import TaskPlayback

TAUGHT = "taught"
"""Folder of the episode in which the path was taught, inside the run's."""

PHASE = "playback"


@dataclass(frozen=True)
class PlaybackResult:
    """How a playback ended.

    Attributes:
        stopped: Why the robot gave up; empty when it played to the end.
        interrupted: Somebody pressed Ctrl-C or sent SIGTERM.
        directory: Of the files.
        summary: Content of ``summary.json``.
    """

    stopped: str
    interrupted: bool
    directory: Path
    summary: dict[str, Any]


def teach(assembly: Assembly, out: Path, seed: int, on_progress: Callable[[float, str], None]) -> JointPath:
    """Lets the springs lead the arm over the map and returns the joint path.

    Raises:
        BadInput: The springs did not come to the end of the task.
    """
    lesson = taught(assembly)
    options = RunOptions(out=out, seed=seed, duration=None, live=False, read_only=False, backend="sim")
    result = carry_out(lesson, sim_backend(lesson, seed), options, on_progress)
    if result.ending is not Ending.DONE:
        raise BadInput(f"the path could not be taught: {result.reason or 'interrupted'} (see {out})")
    return recorded_path(assembly, out)


def recorded_path(assembly: Assembly, log: Path) -> JointPath:
    """Reads a joint path from a recording.

    Raises:
        BadInput: It lacks a joint of the robot.
    """
    episode = read_episode(log, ("position",))
    return JointPath(
        np.asarray(episode.time) - float(episode.time[0]),
        episode.matrix("position", assembly.model.joint_names),
    )


def make_playback(assembly: Assembly, path: JointPath, seed: int, *, noise: bool = True) -> Playback:
    """Builds the plant with its surroundings under the robot's own modes; not yet started.

    Raises:
        BadInput: The task asks for no playback.
    """
    order = _order(assembly)
    plant = playback_plant(assembly, seed, noise=noise)
    return Playback(
        plant, path, PlaybackMode(order.mode), tuple(arm.limb.name for arm in assembly.modules.arms)
    )


def _order(assembly: Assembly) -> TaskPlayback:
    if assembly.task.playback is None:
        raise BadInput(f"task '{assembly.task.name}' asks for no playback: it has no key 'playback'")
    return assembly.task.playback


def play_back(
    assembly: Assembly,
    playback: Playback,
    options: RunOptions,
    on_progress: Callable[[float, str], None],
) -> PlaybackResult:
    """Plays a path to its end, or until the robot stops, and writes the run's files.

    Raises:
        ImpedanceError: The files cannot be written.
    """
    first = playback.start()
    recorder, interrupt = _Recorder(assembly, playback, options), Interrupt()
    with ExitStack() as ending:
        ending.callback(recorder.abandon)
        with interrupt.listening():
            recorder.add(first)
            _play(assembly, playback, options, recorder, interrupt, on_progress)
        summary = recorder.close(interrupted=interrupt.asked)
    draw_run(options.out)
    return PlaybackResult(playback.stopped, interrupt.asked, options.out, summary)


def _play(
    assembly: Assembly,
    playback: Playback,
    options: RunOptions,
    recorder: _Recorder,
    interrupt: Interrupt,
    on_progress: Callable[[float, str], None],
) -> None:
    """Plays on and records until the path or its time ends, somebody interrupts, or the robot stops."""
    end = (
        playback.path.duration if options.duration is None else min(options.duration, playback.path.duration)
    )
    every = max(1, round(assembly.period / TICK))
    ticks = 0
    while not (playback.done or interrupt.asked or playback.now >= end - 0.5 * TICK):
        try:
            state = playback.tick()
        except PlantNotFinite as stop:
            playback.stopped = str(stop)
            break
        ticks += 1
        if ticks % every == 0:
            recorder.add(state)
        if ticks % 100 == 0:
            on_progress(playback.now, PHASE)


class _Recorder:
    """Writes what the robot reports in a playback, and what forces on its hands it implies."""

    def __init__(self, assembly: Assembly, playback: Playback, options: RunOptions) -> None:
        self._assembly, self._playback, self._options = assembly, playback, options
        model = assembly.model
        self._hands = tuple(arm.limb.hand for arm in assembly.modules.arms)
        self._limbs = tuple(arm.limb.name for arm in assembly.modules.arms)
        self._kinematics = Kinematics(model, self._hands)
        self._touch = HandWrenches(model, assembly.modules, self._kinematics, max(assembly.period, TICK))
        columns = ["time"]
        for kind in ("position", "velocity", "effort", "position_command"):
            columns += joint_columns(kind, model.joint_names)
        for hand in self._hands:
            columns += pose_columns(hand)
        for hand in self._hands:
            columns += wrench_columns(hand)
        columns += [f"paused.{limb}" for limb in self._limbs]
        self._writer = EpisodeWriter(options.out, [*columns, "phase"], self._metadata(), wait_for_disk=True)
        self._poses = np.zeros((len(self._hands), 7))
        self._peak = np.zeros(len(self._hands))
        self._started = False

    def _metadata(self) -> dict[str, Any]:
        assembly = self._assembly
        return episode_metadata(
            robot=assembly.robot.name,
            episode=self._options.out.resolve().name,
            effort_source="joint_sensor",
            gravity_compensation=assembly.robot.gravity_compensation,
            repeat_of=None,
            # No torque of a playback is the springs': there is nothing that could be computed again.
            task=None,
            played_back=assembly.task.text,
            mode=self._playback.mode.value,
            task_name=assembly.task.name,
            arms=list(self._limbs),
            rate=assembly.rate,
            seed=self._options.seed,
            backend="sim",
            effects=None if assembly.patch is None else assembly.patch.text,
            versions=library_versions(),
            limbs={arm.limb.name: list(arm.limb.joint_names) for arm in assembly.modules.arms},
        )

    def add(self, state: RobotState) -> None:
        """Records one sample."""
        kinematics, playback = self._kinematics, self._playback
        kinematics.update(state.position, state.velocity)
        if self._started:
            self._touch.update(state)
        else:
            self._touch.reset(state)
        self._started = True
        write_poses(
            kinematics.rotation[: len(self._hands)], kinematics.translation[: len(self._hands)], self._poses
        )
        wrench = self._touch.wrench
        self._peak = np.maximum(self._peak, np.linalg.norm(wrench[:, :3], axis=1))
        paused = [float(playback.paused(limb)) for limb in self._limbs]
        parts = (
            state.position,
            state.velocity,
            state.effort,
            playback.wanted,
            self._poses.ravel(),
            wrench.ravel(),
        )
        self._writer.append(np.concatenate([[state.time], *parts, paused]), PHASE)

    def abandon(self) -> None:
        """Gives the directory back; what was recorded stays as parts."""
        self._writer.abandon()

    def close(self, *, interrupted: bool) -> dict[str, Any]:
        """Merges the episode and writes the summary."""
        playback, assembly = self._playback, self._assembly
        ending = "interrupted" if interrupted else "stopped" if playback.stopped else "done"
        summary: dict[str, Any] = {
            "format": 1,
            "task": assembly.task.name,
            "robot": assembly.robot.name,
            "backend": "sim",
            "mode": playback.mode.value,
            "seed": self._options.seed,
            "rate": assembly.rate,
            "ending": ending,
            "reason": playback.stopped,
            "interrupted": interrupted,
            "duration": playback.now,
            "of": playback.path.duration,
            "collisions": [
                {"time": time, "limb": limb, "kind": kind} for time, limb, kind in playback.collisions
            ],
            "hands": {
                hand: {"peak_force": float(peak), "units": "N"}
                for hand, peak in zip(self._hands, self._peak, strict=True)
            },
        }
        write_summary(self._options.out, summary)
        self._writer.close(ending=ending, reason=playback.stopped)
        return summary
