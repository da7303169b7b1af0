# SPDX-License-Identifier: BSD-3-Clause
"""A task from start to files: assemble, connect, loop, record, summarise."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from impedance_modules.arrays import Array
from impedance_modules.backends.protocol import Backend, RealRobot
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.controller import WarmUp
from impedance_modules.control.gripper_watch import grippers_of
from impedance_modules.control.loop import Interrupt, no_collections, run_loop
from impedance_modules.control.set_point_source import SetPointSource
from impedance_modules.control.signals import as_interrupt
from impedance_modules.control.supervisor import Ending, Supervisor
from impedance_modules.episode.reader import read_episode
from impedance_modules.episode.run_folder import PICTURE, RECORDING, recorded
from impedance_modules.errors import NotRecorded, SafetyStop
from impedance_modules.extras import installed
from impedance_modules.robot.state import RobotState
from impedance_modules.runs.recorder import Recorder
from impedance_modules.runs.run_summary import Summary
from impedance_modules.runs.scene_view import SceneView

PICTURE_SAMPLES = 20_000
"""More would not be seen in the picture, and ten minutes of them would fill 400 MB."""

SIMULATED = ("sim", "mujoco", "replay")
"""Backends whose time is not real: a run may wait for the disk, and is as fast as the machine allows."""

FREE_PART = 0.5
"""Part of a real robot's period, counted from the end of a cycle, in which files are written."""


@dataclass(frozen=True)
class RunOptions:
    """Options of a run, from the command line.

    Attributes:
        out: Directory of its files.
        seed: Of the simulated noise.
        duration: Ends the run safely after this time [s]; None lets the task decide.
        live: Opens a viewer that follows the run.
        read_only: Sends nothing.
        backend: Name of the backend.
        mjcf: MuJoCo model that the robot was simulated with, for the recording to name; None for none.
    """

    out: Path
    seed: int
    duration: float | None
    live: bool
    read_only: bool
    backend: str
    mjcf: Path | None = None


@dataclass(frozen=True)
class RunResult:
    """How a run ended.

    Attributes:
        ending: None when a replay ran out of samples.
        reason: Why it stopped; empty after a task that is done.
        interrupted: Somebody pressed Ctrl-C or sent SIGTERM.
        directory: Of the files.
        summary: Content of ``summary.json``.
    """

    ending: Ending | None
    reason: str
    interrupted: bool
    directory: Path
    summary: dict[str, object]


def carry_out(
    assembly: Assembly,
    backend: Backend,
    options: RunOptions,
    on_progress: Callable[[float, str], None],
    source: SetPointSource | None = None,
) -> RunResult:
    """Runs an assembled task on a robot and writes its files.

    Args:
        assembly: The task.
        backend: The robot, not yet started.
        options: Of the command line.
        on_progress: Called about ten times a second of run time with the time [s] and the phase.
        source: Of set-points, for phases that listen; None where nothing comes.

    Raises:
        ImpedanceError: The robot cannot be started, takes no orders for the task's grippers, or the files cannot be
            written.
    """
    grippers = grippers_of(backend, assembly, f"--backend {options.backend}", read_only=options.read_only)
    supervisor = Supervisor(assembly, source, grippers)
    supervisor.controller.warm()
    simulated = options.backend in SIMULATED
    real = backend if isinstance(backend, RealRobot) else None
    interrupt = Interrupt()
    with ExitStack() as ending:
        # What keeps every thread waiting comes before the robot is taken over: it must be held all the time.
        if real is not None:
            real.warm_up_with(WarmUp(assembly))
        ending.enter_context(no_collections())
        # Whatever happens, the robot is held; once it is, again does nothing.
        ending.callback(backend.finish, "hold")
        with as_interrupt():
            first = backend.start()
            recorder = Recorder(
                options.out,
                supervisor,
                first.acting,
                options.seed,
                options.backend,
                mjcf=options.mjcf,
                simulated=simulated,
                real=real,
            )
            ending.callback(recorder.abandon)
            recorder.warm()
            view = SceneView(options.out, supervisor, recorder.writer.background, live=options.live)
        files = _Files(
            supervisor,
            recorder,
            view,
            Summary(assembly, supervisor, recorder.columns, options.backend, options.seed),
            on_progress,
            free=0.0 if simulated else FREE_PART * assembly.period,
        )
        try:
            with interrupt.listening():
                if real is not None:
                    first = real.newest()
                supervisor.start(first)
                run_loop(
                    supervisor,
                    backend,
                    first.state,
                    files.add,
                    interrupt,
                    duration=options.duration,
                    paced=not simulated,
                    read_only=options.read_only,
                )
        finally:
            found = files.close(options.out, interrupted=interrupt.asked)
    if not recorder.writer.rows:
        raise SafetyStop(f"nothing moved: {supervisor.reason or 'the run ended before its first cycle'}")
    draw_run(options.out)
    return RunResult(supervisor.ending, supervisor.reason, interrupt.asked, options.out, found)


def draw_run(directory: Path) -> None:
    """Draws the picture of a run whose episode is written; nothing where matplotlib is not installed.

    Raises:
        NotRecorded: It cannot be written.
    """
    if not installed("matplotlib"):
        return
    from impedance_modules.episode.run_picture import PICTURE_KINDS, write_picture  # noqa: PLC0415 - an extra

    drawn = read_episode(directory, PICTURE_KINDS, most_samples=PICTURE_SAMPLES)
    with recorded(directory / PICTURE):
        write_picture(drawn, directory / PICTURE)


class _Files:
    """Everything that a run writes, cycle by cycle."""

    def __init__(
        self,
        supervisor: Supervisor,
        recorder: Recorder,
        view: SceneView,
        summary: Summary,
        on_progress: Callable[[float, str], None],
        *,
        free: float,
    ) -> None:
        self._free = free
        self._supervisor, self._recorder, self._view, self._summary = supervisor, recorder, view, summary
        self._on_progress = on_progress
        self._last_shown = -1.0

    def add(self, state: RobotState, effort: Array, late: bool, asked: bool) -> None:
        """Takes one cycle."""
        self._recorder.add(state, effort, late=late, interrupted=asked)
        self._view.add(state, effort)
        self._summary.add(self._recorder.row)
        if state.time - self._last_shown >= 0.1:
            self._last_shown = state.time
            self._on_progress(state.time, self._supervisor.sequence.phase.name)
        if self._free > 0.0:
            self._recorder.writer.background.free_for(self._free)

    def close(self, directory: Path, *, interrupted: bool) -> dict[str, object]:
        """Finishes all files and returns the summary; nothing is left of a run without a cycle.

        Raises:
            NotRecorded: One of them cannot be written. What was recorded before can be read.
        """
        with ExitStack() as last:
            # In this order: the view's last samples are written by the thread that the recorder stops.
            last.callback(self._view.close)
            last.callback(self._recorder.abandon)
            if not self._recorder.writer.rows:
                return {}
            found = self._summary.write(directory, interrupted=interrupted)
            self._recorder.close(str(found["ending"]), str(found["reason"]))
        if self._view.failure is not None:
            raise NotRecorded(
                f"{directory / RECORDING}: cannot be written: {self._view.failure} (valid: a disk with free space;"
                f" the episode is whole)"
            )
        return found
