# SPDX-License-Identifier: BSD-3-Clause
"""``impedance run``: carry a task out, safely, and keep everything that happened."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from impedance_modules.cli.baxter.connect import transport_option
from impedance_modules.cli.options import arm_option, effects_option, rate_option, scale_option, task_argument

if TYPE_CHECKING:
    from impedance_modules.backends.baxter.session import Visit
    from impedance_modules.control.assembly import Assembly
    from impedance_modules.runs.run import RunResult


BACKENDS = ("sim", "replay", "baxter")


@click.command("run")
@task_argument
@arm_option
@click.option("--backend", type=click.Choice(BACKENDS), default="sim", show_default=True, help="Robot.")
@click.option(
    "--log",
    type=click.Path(path_type=Path),
    help="Recording that the replay backend feeds back, or whose joint path a task with playback plays.",
)
@effects_option
@rate_option
@click.option("--duration", type=float, metavar="S", help="End the run safely after this time.")
@click.option(
    "--out", type=click.Path(path_type=Path), help="Directory of the run  [default: out/TASK-TIME]."
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of the simulated noise.")
@scale_option
@click.option("--view", is_flag=True, help="Open the viewer and follow the run.")
@click.option("--read-only", is_flag=True, help="Compute and record everything, send nothing.")
@transport_option
@click.option(
    "--approach",
    is_flag=True,
    help="Let a real robot's position mode bring the arms to the task's start first.",
)
def command(
    task: str,
    arm: str | None,
    backend: str,
    log: Path | None,
    effects: Path | None,
    rate: float | None,
    duration: float | None,
    out: Path | None,
    seed: int,
    scale: float,
    view: bool,
    read_only: bool,
    transport: str,
    approach: bool,
) -> int:
    """Carry out TASK, a file or the name of a shipped task.

    Exit: 0 done, 2 bad input, 3 stopped by safety, by a phase not met or by the robot itself, 130 after Ctrl-C.
    """
    from rich.console import Console

    from impedance_modules.cli.run_playback import PlaybackOptions, play_task_back
    from impedance_modules.cli.tables import print_run, progress
    from impedance_modules.control.assembly import assemble
    from impedance_modules.errors import BadInput
    from impedance_modules.prediction.feasibility import refuse_infeasible

    if duration is not None and not duration > 0.0:
        raise BadInput(f"--duration {duration:g}: a run needs some time (valid: above 0 s)")
    real = backend == "baxter"
    with ExitStack() as closing:
        found = closing.enter_context(_real_robot(transport)) if real else None
        assembly = assemble(
            task,
            effects=effects,
            rate=_real_rate(read_only) if real and rate is None else rate,
            scale=scale,
            arm=arm,
            calibrate=None if found is None else found.calibrate,
        )
        if assembly.task.playback is not None:
            asked = PlaybackOptions(backend, log, duration, _directory(out, assembly), seed, view, read_only)
            return play_task_back(assembly, asked)
        if (backend == "replay") != (log is not None):
            raise BadInput("--backend replay and --log DIR go together: the log is the robot")
        refuse_infeasible(assembly)
        # Only now: everything below wakes the compiler.
        from impedance_modules.runs.prepare import baxter_backend, make_backend
        from impedance_modules.runs.run import RunOptions, carry_out

        robot = (
            make_backend(assembly, backend=backend, log=log, seed=seed)
            if found is None
            else baxter_backend(assembly, found.session, read_only=read_only, approach=approach)
        )
        options = RunOptions(
            out=_directory(out, assembly),
            seed=seed,
            duration=duration,
            live=view,
            read_only=read_only,
            backend=backend,
        )
        console = Console()
        with progress(sum(phase.duration for phase in assembly.task.phases), console) as on_progress:
            result = carry_out(assembly, robot, options, on_progress)
    print_run(result, console)
    return _exit_code(result)


def _directory(out: Path | None, assembly: Assembly) -> Path:
    """Where a run's files go."""
    if out is not None:
        return out
    return Path("out") / f"{assembly.task.name}-{time.strftime('%Y%m%d-%H%M%S')}"


def _exit_code(result: RunResult) -> int:
    from impedance_modules.control.supervisor import Ending

    if result.interrupted:
        return 130
    return 3 if result.ending is Ending.STOPPED else 0


@contextmanager
def _real_robot(transport: str) -> Iterator[Visit]:
    """Brings a node up for the time of a run."""
    from impedance_modules.backends.baxter.session import Visit
    from impedance_modules.cli.baxter.connect import node

    with node(transport, "run") as network:
        yield Visit(network)


def _real_rate(read_only: bool) -> float:
    """Rate of a real robot unless the run says otherwise [Hz]: what it is asked for, or sends unasked."""
    from impedance_modules.backends.baxter.topics import DEFAULT_STATE_RATE, USUAL_RATE

    return DEFAULT_STATE_RATE if read_only else USUAL_RATE
