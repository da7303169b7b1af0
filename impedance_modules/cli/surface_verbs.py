# SPDX-License-Identifier: BSD-3-Clause
"""``impedance map``: shape and stiffness of what a hand touched in a recording (thesis 5.1.5, 6.2.3)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from impedance_modules.episode.data import Episode
    from impedance_modules.tools.surface_fit import SurfaceMap
    from impedance_modules.tools.surface_truth import MapErrors, TrueSurface


@click.command("map")
@click.argument("episode", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder of the map's files.")
@click.option("--hand", metavar="FRAME", help="Which hand, where the episode has more than one.")
@click.option(
    "--force", type=float, default=2.0, show_default=True, metavar="N", help="Least upward force of a touch."
)
@click.option(
    "--cell", type=float, default=0.01, show_default=True, metavar="M", help="Width of a cell of the map."
)
@click.option("--truth", is_flag=True, help="Compare with the surfaces that the built-in plant really had.")
def map_command(episode: Path, out: Path, hand: str | None, force: float, cell: float, truth: bool) -> int:
    """Map the surface that a hand touched in EPISODE, from its position and force alone.

    Writes map.csv, map.json and map.png: the height at which the hand was pressed (tactile map), and, where the force
    varied by 3 N or more, the height at rest and the stiffness (impedance map), with standard errors.

    Exit: 0 done, 2 no force, no contact, or no stroke.
    """
    from impedance_modules.episode.reader import read_episode
    from impedance_modules.episode.run_folder import the_episode
    from impedance_modules.errors import BadInput
    from impedance_modules.tools.surface_fit import map_surface, touches_of
    from impedance_modules.tools.surface_report import write_map

    for name, value in (("--force", force), ("--cell", cell)):
        if not value > 0.0:
            raise BadInput(f"{name} {value:g} (valid: above 0)")
    read = read_episode(the_episode(episode), ("position", "pose", "wrench"))
    touches = touches_of(read, hand, force)
    found = map_surface(touches, cell)
    said = write_map(out, str(episode), touches, found, _compared(read, found) if truth else None)
    _print_map(said, out)
    return 0


def _compared(episode: Episode, found: SurfaceMap) -> tuple[TrueSurface, MapErrors]:
    """Builds the surfaces of the episode's task as the plant wore them."""
    from impedance_modules.errors import BadInput
    from impedance_modules.runs.verify import reassemble
    from impedance_modules.tools.surface_truth import map_errors, true_surface

    if episode.metadata.get("backend") != "sim":
        raise BadInput(
            f"{episode.source}: --truth needs a run of the built-in plant; nobody knows what was there"
        )
    truth = true_surface(reassemble(episode).task.environment, found)
    return truth, map_errors(found, truth)


def _print_map(said: dict[str, Any], out: Path) -> None:
    click.echo(
        f"{said['cells']} cells of {1000 * said['cell']:g} mm touched by {said['hand']}:"
        f" {said['cells_with_shape_at_rest']} with a height at rest, {said['cells_with_stiffness']} with a stiffness"
    )
    if said["cells_with_shape_at_rest"] < said["cells"]:
        click.echo(
            "the others were pressed with nearly the same force all the time; stroke them at another one too"
        )
    errors = said.get("errors_against_the_plant")
    if errors is not None:
        rest, stiffness = errors["shape"], errors["stiffness"]
        click.echo(f"against the plant: pressed height {1000 * errors['pressed']:.2f} mm RMS")
        if rest is not None:
            click.echo(f"  height at rest {1000 * rest:.2f} mm RMS over {errors['shape_cells']} cells")
        if stiffness is not None:
            worst = errors["stiffness_worst"]
            click.echo(f"  stiffness {100 * stiffness:.0f} % off in the median, {100 * worst:.0f} % at worst")
    click.echo(f"files: {out}/ (map.csv, map.json, map.png)")
