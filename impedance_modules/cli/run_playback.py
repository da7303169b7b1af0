# SPDX-License-Identifier: BSD-3-Clause
"""``impedance run`` of a task that the robot itself plays back."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

    from impedance_modules.control.assembly import Assembly


@dataclass(frozen=True)
class PlaybackOptions:
    """What the command line says: as in ``run``; ``log`` is a recording whose joint path is played."""

    backend: str
    log: Path | None
    duration: float | None
    out: Path
    seed: int
    view: bool
    read_only: bool


def play_task_back(assembly: Assembly, options: PlaybackOptions) -> int:
    """Teaches the path unless a recording gives it, plays it, and prints how it ended; returns the exit code.

    Raises:
        BadInput: An option that a playback cannot follow, or a task that cannot be taught.
    """
    _refuse(options)
    from rich.console import Console

    from impedance_modules.cli.tables import progress
    from impedance_modules.control.adjust import as_taught
    from impedance_modules.prediction.feasibility import refuse_infeasible

    refuse_infeasible(replace(assembly, task=as_taught(assembly.task)))
    from impedance_modules.runs.playback import TAUGHT, make_playback, play_back, recorded_path, teach
    from impedance_modules.runs.run import RunOptions

    console = Console()
    seconds = sum(phase.duration for phase in assembly.task.phases)
    if options.log is not None:
        path = recorded_path(assembly, options.log)
    else:
        with progress(seconds, console) as on_progress:
            path = teach(assembly, options.out / TAUGHT, options.seed, on_progress)
    run = RunOptions(options.out, options.seed, options.duration, live=False, read_only=False, backend="sim")
    with progress(path.duration, console) as on_progress:
        result = play_back(assembly, make_playback(assembly, path, options.seed), run, on_progress)
    _print(result.summary, result.directory, console)
    if result.interrupted:
        return 130
    return 3 if result.stopped else 0


def _refuse(options: PlaybackOptions) -> None:
    from impedance_modules.errors import BadInput

    if options.backend != "sim":
        raise BadInput(
            f"--backend {options.backend}: a task with 'playback' bypasses the torque filter and the energy tank, so"
            " it is carried out on the built-in plant only (valid: sim)"
        )
    if options.view or options.read_only:
        raise BadInput("--view and --read-only: a playback has neither a viewer nor torques to keep back")


def _print(summary: dict[str, Any], directory: Path, console: Console) -> None:
    console.print(
        f"{summary['task']} on {summary['robot']}, {summary['mode']} mode of its own", highlight=False
    )
    for collision in summary["collisions"]:
        console.print(
            f"{collision['time']:8.2f} s  {collision['limb']}: {collision['kind']}, the limb pauses",
            highlight=False,
        )
    for hand, numbers in summary["hands"].items():
        console.print(f"{hand}: largest force felt {numbers['peak_force']:.1f} N", highlight=False)
    if summary["ending"] == "done":
        console.print(f"the path was played to its end, {summary['duration']:.2f} s", highlight=False)
    else:
        console.print(
            f"{summary['ending']} after {summary['duration']:.2f} of {summary['of']:.2f} s", highlight=False
        )
        console.print(summary["reason"], highlight=False)
    console.print(f"files: {directory}/ (episode.parquet, summary.json, picture.png)", highlight=False)
