# SPDX-License-Identifier: BSD-3-Clause
"""``impedance import``: recordings of other programs become episodes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from impedance_modules.cli.plain_lines import say
from impedance_modules.errors import BadInput

if TYPE_CHECKING:
    from collections.abc import Sequence

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
    "--urdf",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Without a map: URDF or MuJoCo model that names the joints of a log which only numbers them.",
)
@click.option(
    "--write-map",
    "write_map",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Import nothing; write the map of SOURCE, as far as SOURCE says it, to be completed.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Where the episodes go, DIR/NAME.parquet.",
)
def import_command(
    sources: tuple[Path, ...],
    map_path: Path | None,
    rate: float | None,
    urdf: Path | None,
    write_map: Path | None,
    out: Path | None,
) -> int:
    """Turn each SOURCE into an episode: a table, .mat or .npz file, a ROS recording (.bag, .mcap, .db3) or a dataset.

    A ROS recording of a shipped robot, a joint recorder's file, a log of libfranka (with --urdf) and an episode need
    no map. If anything is wrong with any source, nothing is written.

    Exit: 0 done, 2 bad input.
    """
    from impedance_modules.episode.imports.pipeline import import_sources

    if write_map is not None:
        return _write_map(sources, map_path, urdf, write_map)
    if out is None:
        raise BadInput("import needs to know where the episodes go (valid: --out DIR)")
    for imported in import_sources(sources, map_path, rate, out, urdf):
        say(_sentence(imported))
        for note in imported.notes:
            say(f"  note: {note}")
    return 0


def _write_map(sources: Sequence[Path], map_path: Path | None, urdf: Path | None, target: Path) -> int:
    """Writes the map of one source, with what is still to be stated as comments on top."""
    from impedance_modules.episode.imports.generated_maps import map_for

    if map_path is not None or len(sources) != 1:
        raise BadInput("--write-map makes the map of one SOURCE (valid: one SOURCE, and no --map)")
    if target.exists():
        raise BadInput(f"{target}: already there (valid: another --write-map, or remove it)")
    found = map_for(sources[0], urdf)
    asked = "".join(f"# TO BE STATED: {sentence}\n" for sentence in found.missing)
    try:
        target.write_text(asked + found.text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"{target}: cannot be written: {error.strerror} (valid: a writable place)") from error
    say(f"written: {target}")
    for sentence in found.missing:
        say(f"  to be stated in it: {sentence}")
    return 0


def _sentence(imported: Imported) -> str:
    """One line about an episode."""
    joints = f"{imported.joints} joint{'' if imported.joints == 1 else 's'}"
    stated = " as stated" if imported.rate_stated else ""
    return (
        f"{imported.path}: {imported.samples} samples of {joints}, {imported.duration:.6g} s at"
        f" {imported.rate:.6g} Hz{stated}: {', '.join(imported.kinds)}"
    )
