# SPDX-License-Identifier: BSD-3-Clause
"""Short tables for the terminal, and the progress bar of a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Table

from impedance_modules.episode.run_folder import PICTURE
from impedance_modules.extras import how_to_install, installed
from impedance_modules.runs.execution import RunResult


@contextmanager
def progress(total: float, console: Console) -> Iterator[Callable[[float, str], None]]:
    """Shows how far a run is, on a terminal only.

    Args:
        total: Longest time the task can take without waiting for its tank [s].
        console: Where to show it.
    """
    if not console.is_terminal:
        yield lambda *_: None
        return
    columns = (
        TextColumn("{task.description:<16}", markup=False),
        BarColumn(),
        TextColumn("{task.completed:6.1f} of at most {task.total:.1f} s"),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        row = bar.add_task("starting", total=total)
        yield lambda time, phase: bar.update(row, completed=time, description=phase)


def print_run(result: RunResult, console: Console) -> None:
    """Prints how a run ended, its numbers, and where its files are."""
    summary: dict[str, Any] = result.summary
    console.print(_phases(summary))
    console.print(_numbers(summary))
    for line in _endings(summary):
        console.print(line, highlight=False)
    print_files(result.directory, ("episode.parquet", "recording.rrd", "summary.json"), console)


def print_files(directory: Path, names: tuple[str, ...], console: Console) -> None:
    """Prints which files a run has left; with the picture, or how to get it."""
    drawn = (PICTURE,) if (directory / PICTURE).exists() else ()
    console.print(f"files: {directory}/ ({', '.join((*names, *drawn))})", highlight=False)
    if not drawn and not installed("matplotlib"):
        console.print(f"no {PICTURE}: it needs matplotlib ({how_to_install('matplotlib')})", markup=False)


def _phases(summary: dict[str, Any]) -> Table:
    table = Table(
        title=f"{summary['task']} on {summary['robot']} ({summary['backend']})", title_justify="left"
    )
    table.add_column("phase")
    table.add_column("seconds", justify="right")
    table.add_column("ended by")
    table.add_column("hands from their targets then")
    for phase in summary["phases"]:
        table.add_row(phase["name"], f"{phase['seconds']:.2f}", phase["ended_by"], _errors(phase["hands"]))
    return table


def _errors(hands: dict[str, Any]) -> str:
    """Writes position and orientation error of every hand at a phase's end, one a line."""
    return "\n".join(
        f"{hand}: {1000 * found['position_error']:.1f} mm, {math.degrees(found['orientation_error']):.1f}°"
        for hand, found in hands.items()
    )


def _numbers(summary: dict[str, Any]) -> Table:
    table = Table(show_header=True)
    table.add_column("quantity")
    table.add_column("value", justify="right")
    table.add_column("unit")
    for hand, numbers in summary["hands"].items():
        table.add_row(f"{hand}: distance to target, RMS", f"{1000 * numbers['tracking_rms']:.1f}", "mm")
        forces = f"{numbers['start_force']:.1f}, {numbers['peak_force']:.1f}"
        table.add_row(f"{hand}: force at the start, at most", forces, "N")
    if "hinge" in summary:
        hinge = summary["hinge"]
        angles = f"{hinge['lowest_angle']:.3f}, {hinge['highest_angle']:.3f}, {hinge['final_angle']:.3f}"
        table.add_row("hinge: lowest, highest, last angle", angles, "rad")
        table.add_row(
            "hinge: torque of the hands about its axis, at most", f"{hinge['peak_torque']:.2f}", "N.m"
        )
    joint, ratio = max(summary["torque_peak_over_limit"].items(), key=lambda item: item[1])
    table.add_row(f"largest torque, of its limit ({joint})", f"{100 * ratio:.0f}", "%")
    tank = summary["tank"]
    table.add_row("tank: start, lowest", f"{tank['initial']:.2f}, {tank['lowest']:.2f}", "J")
    table.add_row("cycles slowed by the tank", f"{tank['cycles_slowed']} of {summary['cycles']}", "")
    changed = summary["filter"]["cycles_changed"]
    table.add_row("cycles changed by the filter", f"{changed} of {summary['cycles']}", "")
    return table


def _endings(summary: dict[str, Any]) -> list[str]:
    lines = []
    reductions = summary["filter"]["reductions"]
    if reductions:
        first = reductions[0]
        lines.append(
            f"most reduced: {first['module']} by row '{first['row']}', {first['mean']:.3f} N.m on average"
        )
    if summary["ending"] == "done":
        lines.append("the task was carried out")
    else:
        lines.append(f"{summary['ending']}: {summary['reason']}")
        where = _errors(summary["ended_in"]["hands"]).replace("\n", ", ")
        if where:
            lines.append(f"in phase '{summary['ended_in']['phase']}', hands from their targets then: {where}")
    return lines
