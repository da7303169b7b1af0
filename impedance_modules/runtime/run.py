# SPDX-License-Identifier: BSD-3-Clause
"""A task from start to files: assemble, connect, loop, record, summarise."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.backend import Backend, Instrumented
from impedance_modules.episode.picture import PICTURE_KINDS, write_picture
from impedance_modules.episode.reader import read_episode
from impedance_modules.errors import ImpedanceError
from impedance_modules.robot.state import RobotState
from impedance_modules.runtime.assembly import Assembly
from impedance_modules.runtime.loop import Interrupt, no_collections, run_loop, sigterm_as_interrupt
from impedance_modules.runtime.record import Recorder
from impedance_modules.runtime.scene import SceneView
from impedance_modules.runtime.summary import Summary
from impedance_modules.runtime.supervisor import Ending, Supervisor

Array = NDArray[np.float64]


PICTURE_SAMPLES = 20_000
"""More would not be seen in the picture, and ten minutes of them would fill 400 MB."""


@dataclass(frozen=True)
class RunOptions:
    """What the command line says about a run.

    Attributes:
        out: Directory of its files.
        seed: Of the simulated noise.
        duration: Ends the run safely after this time [s]; None lets the task decide.
        live: Opens a viewer that follows the run.
        read_only: Sends nothing.
        backend: Name of the backend.
    """

    out: Path
    seed: int
    duration: float | None
    live: bool
    read_only: bool
    backend: str


@dataclass(frozen=True)
class RunResult:
    """How a run ended.

    Attributes:
        ending: None when a replay ran out of samples.
        reason: Why it stopped; empty after a task that is done.
        interrupted: Somebody pressed Ctrl-C or sent SIGTERM.
        directory: Of the files.
        summary: What ``summary.json`` says.
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
) -> RunResult:
    """Runs an assembled task on a robot and writes its files.

    Args:
        assembly: The task.
        backend: The robot, not yet started.
        options: Of the command line.
        on_progress: Called about ten times a second of run time with the time [s] and the phase.

    Raises:
        ImpedanceError: The robot cannot be started or the files cannot be written.
    """
    supervisor = Supervisor(assembly)
    supervisor.controller.warm()
    simulated = options.backend in ("sim", "replay")
    with ExitStack() as undo, sigterm_as_interrupt():
        # Whatever happens before the loop, which sees to it by itself, the robot is held.
        undo.callback(backend.finish, "hold")
        first = backend.start()
        more = backend if isinstance(backend, Instrumented) else None
        recorder = Recorder(
            options.out,
            supervisor,
            first.acting,
            options.seed,
            options.backend,
            simulated=simulated,
            more=more,
        )
        try:
            supervisor.start(first)
        except ImpedanceError:
            recorder.abandon()
            raise
        view = SceneView(options.out, supervisor, recorder.writer.background, live=options.live)
        undo.pop_all()
    summary = Summary(assembly, supervisor, recorder.columns, options.backend, options.seed)
    interrupt = Interrupt()
    last_shown = [-1.0]

    def on_cycle(state: RobotState, effort: Array, late: bool, asked: bool) -> None:
        recorder.add(state, effort, late=late, interrupted=asked)
        view.add(state, effort)
        summary.add(recorder.row)
        if state.time - last_shown[0] >= 0.1:
            last_shown[0] = state.time
            on_progress(state.time, supervisor.sequence.phase.name)

    try:
        with interrupt.listening(), no_collections():
            run_loop(
                supervisor,
                backend,
                first.state,
                on_cycle,
                interrupt,
                duration=options.duration,
                paced=not simulated,
                read_only=options.read_only,
            )
    finally:
        found = summary.write(options.out, interrupted=interrupt.asked)
        try:
            recorder.close(str(found["ending"]), str(found["reason"]))
        finally:
            view.close()
    write_picture(
        read_episode(options.out, PICTURE_KINDS, most_samples=PICTURE_SAMPLES), options.out / "picture.png"
    )
    return RunResult(supervisor.ending, supervisor.reason, interrupt.asked, options.out, found)
