# SPDX-License-Identifier: BSD-3-Clause
"""``impedance import``: recordings of other programs become episodes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from impedance_modules.cli.plain_lines import say

if TYPE_CHECKING:
    from impedance_modules.episode.imports.pipeline import Imported


@click.command("import")
@click.argument("sources", metavar="SOURCE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--map",
    "map_path",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="What the columns mean: units, time, gears, sensors (docs/import.md).",
)
@click.option("--rate", type=float, metavar="HZ", help="Samples in a second of a log without time.")
@click.option(
    "--out",
    required=True,
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Where the episodes go, DIR/NAME.parquet.",
)
def import_command(sources: tuple[Path, ...], map_path: Path | None, rate: float | None, out: Path) -> int:
    """Turn each SOURCE into an episode: a table, .mat or .npz file, or a ROS recording (.bag, .mcap, .db3).

    A ROS recording of a shipped robot, a joint recorder's file and an episode need no map. If anything is wrong
    with any source, nothing is written.

    Exit: 0 done, 2 bad input.
    """
    from impedance_modules.episode.imports.pipeline import import_sources

    for imported in import_sources(sources, map_path, rate, out):
        say(_sentence(imported))
        for note in imported.notes:
            say(f"  note: {note}")
    return 0


def _sentence(imported: Imported) -> str:
    """One line about an episode."""
    joints = f"{imported.joints} joint{'' if imported.joints == 1 else 's'}"
    stated = " as stated" if imported.rate_stated else ""
    return (
        f"{imported.path}: {imported.samples} samples of {joints}, {imported.duration:.6g} s at"
        f" {imported.rate:.6g} Hz{stated}: {', '.join(imported.kinds)}"
    )
