# SPDX-License-Identifier: BSD-3-Clause
"""``impedance run``: carry a task out and record it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from impedance_modules.cli.baxter.connection import transport_option
from impedance_modules.cli.connection_options import NOWHERE, Reached, connection_options
from impedance_modules.cli.listening import refuse_listening, set_points_of
from impedance_modules.cli.plant_trial import trial_line, tried
from impedance_modules.cli.shared_options import (
    arm_option,
    compensate_option,
    effects_option,
    rate_option,
    robot_option,
    scale_option,
    task_argument,
)

if TYPE_CHECKING:
    from rich.console import Console

    from impedance_modules.backends.baxter.session import DeferredSession
    from impedance_modules.backends.protocol import Backend
    from impedance_modules.control.assembly import Assembly
    from impedance_modules.runs.execution import RunResult

BACKENDS = ("sim", "mujoco", "replay", "baxter", "franka", "ros2")
REAL = ("baxter", "franka", "ros2")
"""Backends of robots in real time."""


class _BackendName(click.ParamType[str, str]):
    """A backend of this package or of another one that is installed."""

    name = "|".join(BACKENDS)

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Refuses a name that no package has."""
        from impedance_modules.installed import BACKENDS as GROUP
        from impedance_modules.installed import installed

        if value not in BACKENDS and value not in (more := installed(GROUP)):
            self.fail(f"'{value}' is no backend (valid: {', '.join([*BACKENDS, *more])})", param, ctx)
        return value


@click.command("run")
@task_argument
@arm_option
@robot_option
@click.option(
    "--backend",
    type=_BackendName(),
    default="sim",
    show_default=True,
    help="Robot; other installed packages may add more.",
)
@click.option(
    "--log",
    type=click.Path(path_type=Path),
    help="Recording that the replay backend feeds back, or whose joint path a task with playback plays.",
)
@click.option(
    "--mjcf",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="MuJoCo model of the robot, or of one of its arms, for the mujoco backend  [default: the robot folder's].",
)
@effects_option
@compensate_option
@rate_option
@click.option("--duration", type=float, metavar="S", help="End the run safely after this time.")
@click.option(
    "--out", type=click.Path(path_type=Path), help="Directory of the run  [default: out/TASK-TIME]."
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of the simulated noise.")
@scale_option
@click.option("--view", is_flag=True, help="Open the viewer and follow the run.")
@click.option("--read-only", is_flag=True, help="Compute and record everything, send nothing.")
@click.option(
    "--allow-unstable",
    is_flag=True,
    help="Run although a loop is predicted to be unstable; in simulation only.",
)
@transport_option
@click.option(
    "--approach",
    is_flag=True,
    help="Let a real robot's position mode bring the arms to the task's start first.",
)
@click.option(
    "--listen",
    is_flag=False,
    flag_value="",
    metavar="[HOST:PORT]",
    help="Follow set-points that arrive there, in phases that listen; simulated robots then run in real time"
    "  [default: 127.0.0.1:5586].",
)
@connection_options
def run_command(
    task: str,
    arm: str | None,
    robot: str | None,
    backend: str,
    log: Path | None,
    mjcf: Path | None,
    effects: Path | None,
    compensate: Path | None,
    rate: float | None,
    duration: float | None,
    out: Path | None,
    seed: int,
    scale: float,
    view: bool,
    read_only: bool,
    allow_unstable: bool,
    transport: str,
    approach: bool,
    listen: str | None,
    connection: Path | None,
    address: tuple[str, ...],
    recover: bool,
) -> int:
    """Carry out TASK, a file or the name of a shipped task.

    Exit: 0 done, 2 bad input, 3 stopped by safety, by a phase not met or by the robot itself, 130 after Ctrl-C.
    """
    from impedance_modules.cli.print_run import print_run
    from impedance_modules.cli.terminal import Terminal
    from impedance_modules.control.assembly import assemble
    from impedance_modules.errors import BadInput

    if duration is not None and not duration > 0.0:
        raise BadInput(f"--duration {duration:g}: a run needs some time (valid: above 0 s)")
    if backend in REAL and allow_unstable:
        raise BadInput(
            "--allow-unstable: a real robot runs no loop that is predicted to be unstable (valid: sim, mujoco, replay)"
        )
    reached = Reached(connection, address, recover)
    reached.refuse_unused(backend)
    if approach and backend == "ros2":
        raise BadInput("--approach: an effort controller knows no positions (valid: baxter, franka)")
    console = Terminal()
    with ExitStack() as closing:
        found = closing.enter_context(_real_robot(transport)) if backend == "baxter" else None
        assembly = assemble(
            task,
            effects=effects,
            compensate=compensate,
            rate=_real_rate(read_only) if found is not None and rate is None else rate,
            scale=scale,
            arm=arm,
            calibrate=None if found is None else found.calibrate,
            robot_name=robot,
        )
        assembly = replace(assembly, allow_unstable=allow_unstable)
        asked = RunRequest(
            backend,
            log,
            mjcf,
            duration,
            _directory(out, assembly),
            seed,
            view,
            read_only,
            approach,
            listen,
            reached,
        )
        refuse_listening(assembly, asked)
        if assembly.task.playback is not None:
            return play_task_back(assembly, asked)
        result = _carry_out(assembly, found, asked, console)
    print_run(result, console)
    return _exit_code(result)


@dataclass(frozen=True)
class RunRequest:
    """The options of ``impedance run``.

    ``log`` is the recording that is fed back, or whose joint path is played; ``listen`` is where set-points arrive,
    None for nowhere; ``reached`` is where a real robot is.
    """

    backend: str
    log: Path | None
    mjcf: Path | None
    duration: float | None
    out: Path
    seed: int
    view: bool
    read_only: bool
    approach: bool
    listen: str | None = None
    reached: Reached = NOWHERE


def play_task_back(assembly: Assembly, options: RunRequest) -> int:
    """Teaches the path unless a recording gives it, plays it, and prints how it ended; returns the exit code.

    Raises:
        BadInput: An option that a playback cannot follow, or a task that cannot be taught.
    """
    _refuse_playback(options)
    from impedance_modules.cli.print_run import progress
    from impedance_modules.cli.terminal import Terminal
    from impedance_modules.runs.task_acceptance import accept

    accept(assembly)
    from impedance_modules.runs.execution import RunOptions
    from impedance_modules.runs.playback_run import TAUGHT, make_playback, play_back, recorded_path, teach

    console = Terminal()
    seconds = sum(phase.duration for phase in assembly.task.phases)
    if options.log is not None:
        path = recorded_path(assembly, options.log)
    else:
        with progress(seconds, console) as on_progress:
            path = teach(assembly, options.out / TAUGHT, options.seed, on_progress)
    run = RunOptions(options.out, options.seed, options.duration, live=False, read_only=False, backend="sim")
    with progress(path.duration, console) as on_progress:
        result = play_back(assembly, make_playback(assembly, path, options.seed), run, on_progress)
    _print_playback(result.summary, result.directory, console)
    if result.interrupted:
        return 130
    return 3 if result.stopped else 0


def _carry_out(
    assembly: Assembly, found: DeferredSession | None, asked: RunRequest, console: Console
) -> RunResult:
    """Runs a task whose springs command the torques."""
    from impedance_modules.cli.print_run import progress
    from impedance_modules.errors import BadInput
    from impedance_modules.runs.task_acceptance import accept

    if (asked.backend == "replay") != (asked.log is not None):
        raise BadInput("--backend replay and --log DIR go together: the log is the robot")
    if asked.mjcf is not None and asked.backend != "mujoco":
        raise BadInput(f"--mjcf: --backend {asked.backend} takes no MuJoCo model (valid: --backend mujoco)")
    # Read-only, no torque is sent: there is no loop that could be unstable.
    judged = replace(assembly, allow_unstable=assembly.allow_unstable or asked.read_only)
    prediction = accept(judged, plant=asked.backend == "sim")
    trial = None if asked.backend == "replay" else tried(judged, prediction, asked.seed, console)
    if trial is not None:
        console.print(trial_line(trial), highlight=False, soft_wrap=True)
    # Imported only here: from this line on functions are compiled.
    from impedance_modules.backends.wall_clock import RealTime
    from impedance_modules.runs.execution import SIMULATED, RunOptions, carry_out

    robot = _robot(assembly, found, asked)
    options = RunOptions(
        out=asked.out,
        seed=asked.seed,
        duration=asked.duration,
        live=asked.view,
        read_only=asked.read_only,
        backend=asked.backend,
        mjcf=asked.mjcf,
    )
    with ExitStack() as closing:
        source = set_points_of(assembly, asked, closing, console)
        if asked.listen is not None and asked.backend in SIMULATED:
            robot = RealTime(robot)
        on_progress = closing.enter_context(
            progress(sum(phase.duration for phase in assembly.task.phases), console)
        )
        return carry_out(assembly, robot, options, on_progress, source)


def _robot(assembly: Assembly, found: DeferredSession | None, asked: RunRequest) -> Backend:
    """Makes the backend, not yet started."""
    from impedance_modules.runs.run_backends import baxter_backend, make_backend

    if found is not None:
        return baxter_backend(assembly, found.session, read_only=asked.read_only, approach=asked.approach)
    if asked.backend == "franka":
        from impedance_modules.runs.arm_backends import franka_backend

        return franka_backend(
            assembly,
            asked.reached.of_franka(assembly.robot),
            asked.reached.recover,
            asked.read_only,
            asked.approach,
        )
    if asked.backend == "ros2":
        from impedance_modules.runs.arm_backends import ros2_backend

        return ros2_backend(assembly, asked.reached.of_ros2(), asked.read_only)
    return make_backend(assembly, backend=asked.backend, log=asked.log, seed=asked.seed, mjcf=asked.mjcf)


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
def _real_robot(transport: str) -> Iterator[DeferredSession]:
    """Starts a node for the time of a run."""
    from impedance_modules.backends.baxter.session import DeferredSession
    from impedance_modules.cli.baxter.connection import node

    with node(transport, "run") as network:
        yield DeferredSession(network)


def _real_rate(read_only: bool) -> float:
    """Rate of a real robot without --rate [Hz]: the rate that is requested, or, read-only, the robot's own."""
    from impedance_modules.backends.baxter.topics import DEFAULT_STATE_RATE, USUAL_RATE

    return DEFAULT_STATE_RATE if read_only else USUAL_RATE


def _refuse_playback(options: RunRequest) -> None:
    from impedance_modules.errors import BadInput

    if options.backend != "sim":
        raise BadInput(
            f"--backend {options.backend}: a task with 'playback' bypasses the torque filter and the energy tank, so"
            " it is carried out on the built-in plant only (valid: sim)"
        )
    if options.view or options.read_only:
        raise BadInput("--view and --read-only: a playback has neither a viewer nor torques to withhold")


def _print_playback(summary: dict[str, Any], directory: Path, console: Console) -> None:
    console.print(
        f"{summary['task']} on {summary['robot']}, {summary['mode']} mode of its own", highlight=False
    )
    for collision in summary["collisions"]:
        console.print(
            f"{collision['time']:8.2f} s  {collision['limb']}: {collision['kind']}, the limb pauses",
            highlight=False,
        )
    for hand, numbers in summary["hands"].items():
        console.print(f"{hand}: largest force {numbers['peak_force']:.1f} N", highlight=False)
    if summary["ending"] == "done":
        console.print(f"the path was played to its end, {summary['duration']:.2f} s", highlight=False)
    else:
        console.print(
            f"{summary['ending']} after {summary['duration']:.2f} of {summary['of']:.2f} s", highlight=False
        )
        console.print(summary["reason"], highlight=False)
    from impedance_modules.cli.print_run import print_files

    print_files(directory, ("episode.parquet", "summary.json"), console)
