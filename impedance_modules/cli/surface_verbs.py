# SPDX-License-Identifier: BSD-3-Clause
"""``impedance map`` and ``impedance roughness``: shape, stiffness and roughness of a surface that a hand touched.

Thesis 5.1.5, 6.2.3 (map) and 5.2.4 (roughness).
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from impedance_modules.cli.plain_lines import say

if TYPE_CHECKING:
    from impedance_modules.episode.data import Episode
    from impedance_modules.tools.recorded_roughness import Roughness
    from impedance_modules.tools.surface_fit import SurfaceMap
    from impedance_modules.tools.surface_truth import MapErrors, TrueSurface

WAY = "x|-x|y|-y|z|-z"


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
    from impedance_modules.extras import need

    need("matplotlib", "impedance map")
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


@click.command("roughness")
@click.argument("episode", type=click.Path(path_type=Path))
@click.option("--hand", metavar="FRAME", help="Which hand, where the episode has more than one.")
@click.option("--along", metavar=WAY, help="Strokes that count. Default: the main motion, towards the robot.")
@click.option("--normal", default="z", show_default=True, metavar=WAY, help="Out of the surface, in world.")
@click.option(
    "--windows", type=click.IntRange(1), default=8, show_default=True, help="Least number of windows."
)
@click.option("--from", "since", type=float, default=-math.inf, help="First time that counts [s].")
@click.option("--to", "until", type=float, default=math.inf, help="Last time that counts [s].")
@click.option("--json", "json_path", type=click.Path(path_type=Path), metavar="F", help="Write the numbers.")
def roughness_command(
    episode: Path,
    hand: str | None,
    along: str | None,
    normal: str,
    windows: int,
    since: float,
    until: float,
    json_path: Path | None,
) -> int:
    """Judge the roughness of what a hand rubbed, from its position and force alone.

    Every stroke gives a window of 0.8 s from where the hand starts to move: its tangential force around 20 Hz, and its
    coefficient of friction.

    Exit: 0 done, 2 no contact, no force, or too few windows.
    """
    from impedance_modules.control.roughness_detection import way_of
    from impedance_modules.episode.reader import read_episode
    from impedance_modules.episode.run_folder import the_episode
    from impedance_modules.errors import BadInput
    from impedance_modules.tools.recorded_roughness import judge_roughness, touched_by

    if not since < until:
        raise BadInput(f"--from {since:g} --to {until:g}: no time lies between (valid: --from before --to)")
    ways = None if along is None else way_of(along), way_of(normal)
    touched = touched_by(
        read_episode(the_episode(episode), kinds=("position", "velocity", "effort", "wrench", "pose")), hand
    )
    found = judge_roughness(touched, *ways, least=windows, span=(since, until))
    if json_path is not None:
        json_path.parent.mkdir(parents=True, exist_ok=True)
        json_path.write_text(json.dumps(_roughness_json(found), indent=2, allow_nan=False) + "\n")
    _print_roughness(found)
    return 0


def _compared(episode: Episode, found: SurfaceMap) -> tuple[TrueSurface, MapErrors]:
    """Builds the surfaces of the episode's task as the plant had them, effects applied."""
    from impedance_modules.errors import BadInput
    from impedance_modules.runs.verify import reassemble
    from impedance_modules.tools.surface_truth import map_errors, true_surface

    if episode.metadata.get("backend") not in ("sim", "mujoco"):
        raise BadInput(
            f"{episode.source}: --truth needs a simulated run; the true surface is unknown otherwise"
        )
    truth = true_surface(reassemble(episode).task.environment, found)
    return truth, map_errors(found, truth)


def _print_map(said: dict[str, Any], out: Path) -> None:
    say(
        f"{said['cells']} cells of {1000 * said['cell']:g} mm touched by {said['hand']}:"
        f" {said['cells_with_shape_at_rest']} with a height at rest, {said['cells_with_stiffness']} with a stiffness"
    )
    if said["cells_with_shape_at_rest"] < said["cells"]:
        say("the others were pressed with nearly the same force all the time; stroke them at another one too")
    errors = said.get("errors_against_the_plant")
    if errors is not None:
        rest, stiffness = errors["shape"], errors["stiffness"]
        say(f"against the plant: pressed height {1000 * errors['pressed']:.2f} mm RMS")
        if rest is not None:
            say(f"  height at rest {1000 * rest:.2f} mm RMS over {errors['shape_cells']} cells")
        if stiffness is not None:
            worst = errors["stiffness_worst"]
            say(f"  stiffness {100 * stiffness:.0f} % off in the median, {100 * worst:.0f} % at worst")
    say(f"files: {out}/ (map.csv, map.json, map.png)")


def _roughness_json(found: Roughness) -> dict[str, object]:
    """Makes plain data of it."""
    nu, amplitude = found.spectrum
    names = ("start", "band", "friction", "normal", "travel")
    return {
        "format": 1,
        "hand": found.touched.hand,
        "force_from": found.touched.source,
        "along": found.directions.along.tolist(),
        "normal": found.directions.normal.tolist(),
        "windows": [{name: getattr(window, name) for name in names} for window in found.windows],
        "refused": found.refused,
        "spectrum": {"frequency_hz": nu.tolist(), "amplitude_n": amplitude.tolist()},
    }


def _print_roughness(found: Roughness) -> None:
    from rich.table import Table

    from impedance_modules.cli.terminal import Terminal

    table = Table(title=f"{found.touched.hand}, force from {found.touched.source}", title_justify="left")
    for name in ("window from s", "15 to 25 Hz, N rms", "friction", "normal N", "travel mm"):
        table.add_column(name, justify="right")
    for window in found.windows:
        table.add_row(*_cells(window.start, window.band, window.friction, window.normal, window.travel))
    table.add_section()
    columns = [found.of(name) for name in ("band", "friction", "normal", "travel")]
    table.add_row("mean", *_cells(0.0, *(float(column.mean()) for column in columns))[1:])
    table.add_row("deviation", *_cells(0.0, *(float(column.std()) for column in columns))[1:])
    console = Terminal()
    console.print(table)
    for why, count in found.refused.items():
        console.print(f"{count} strokes gave no window: {why}")


def _cells(start: float, band: float, friction: float, normal: float, travel: float) -> tuple[str, ...]:
    return (f"{start:.2f}", f"{band:.3f}", f"{friction:.3f}", f"{normal:.2f}", f"{1e3 * travel:.0f}")
