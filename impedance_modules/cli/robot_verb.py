# SPDX-License-Identifier: BSD-3-Clause
"""``impedance robot new``: a robot folder made of a robot description."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING

import click

from impedance_modules.cli.plain_lines import say
from impedance_modules.cli.shared_options import held_positions

if TYPE_CHECKING:
    from impedance_modules.new_robot.folder import MadeRobot

PATH = click.Path(path_type=Path)
PAIR = ("right", "left")
"""Limbs of a pair that --mirror makes; one arm alone is called like the first, so that tasks for one arm find it."""

Base = tuple[float, float, float, float, float, float]


@click.group("robot")
def robot_command() -> None:
    """Robot folders: what tasks run on."""


@robot_command.command("new")
@click.argument("name", metavar="NAME")
@click.option("--urdf", required=True, type=PATH, metavar="FILE", help="URDF, xacro file or MuJoCo model.")
@click.option(
    "--hand",
    "hands",
    multiple=True,
    metavar="[LIMB=]LINK",
    help="Link that is the hand; once for each arm of FILE.  [default: the outermost, if there is one chain]",
)
@click.option(
    "--mirror",
    type=float,
    metavar="D",
    help="Two copies of FILE, right and left, their bases D metres apart along y, facing x.",
)
@click.option(
    "--base",
    "bases",
    multiple=True,
    metavar="LIMB=X,Y,Z[,ROLL,PITCH,YAW]",
    help="One copy of FILE for a limb, standing there (m, rad); once for each copy.",
)
@click.option(
    "--hold", multiple=True, metavar="JOINT=POSITION", help="Where a joint of no arm stays (rad, m)."
)
@click.option("--srdf", type=PATH, metavar="FILE", help="SRDF: which links may touch, and named postures.")
@click.option(
    "--shapes",
    type=click.Choice(["meshes", "capsules", "none"]),
    default="meshes",
    show_default=True,
    help="Collision meshes: copied, a capsule around each, or no shapes at all.",
)
@click.option(
    "--gravity",
    type=click.Choice(["robot", "command", "none"]),
    help="What carries the arms' weight: the robot, each command, nothing.",
)
@click.option(
    "--modes", metavar="MODE,...", help="What the robot can be commanded in: torque, position, velocity."
)
@click.option(
    "--source", default="", metavar="TEXT", help="Where FILE comes from; written beside the numbers."
)
@click.option(
    "--out", type=PATH, default=Path("robots"), show_default=True, metavar="DIR", help="Folder of robots."
)
def new_command(
    name: str,
    urdf: Path,
    hands: tuple[str, ...],
    mirror: float | None,
    bases: tuple[str, ...],
    hold: tuple[str, ...],
    srdf: Path | None,
    shapes: str,
    gravity: str | None,
    modes: str | None,
    source: str,
    out: Path,
) -> int:
    """Make DIR/NAME, a robot that tasks run on, of a description FILE.

    Everything that FILE knows goes into the folder, with its source beside it. What no description states stands
    there with a cautious value, is marked as assumed, and `check` says what follows from it until a person has filled
    it in. A folder that is there already is left alone.

    Exit: 0 made, 2 the description cannot be used; nothing is written then.
    """
    from impedance_modules.new_robot.folder import NewRobot, make_robot

    standing = _bases(mirror, bases)
    asked = NewRobot(
        name=_name(name),
        description=urdf,
        folder=out,
        hands=_hands(hands, tuple(standing)),
        bases=standing,
        held=held_positions(hold),
        srdf=srdf,
        shapes=shapes,
        gravity=gravity,
        modes=_modes(modes),
        source=" ".join(source.split()),
    )
    _print(make_robot(asked))
    return 0


def _name(name: str) -> str:
    from impedance_modules.errors import BadInput

    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,99}", name):
        raise BadInput(
            f"{name[:60]!r} is no name of a robot (valid: letters, digits, - and _, as in ur5e-pair)"
        )
    return name


def _modes(text: str | None) -> tuple[str, ...]:
    from impedance_modules.errors import BadInput

    found = tuple(dict.fromkeys(text.split(","))) if text else ()
    known = ("torque", "position", "velocity")
    if any(mode not in known for mode in found):
        raise BadInput(f"--modes {text}: unknown (valid: {', '.join(known)}, separated by commas)")
    return found


def _hands(entries: tuple[str, ...], copies: tuple[str, ...]) -> dict[str, str | None]:
    """Reads --hand; copies of one description all have the same one."""
    from impedance_modules.errors import BadInput

    found: dict[str, str | None] = {}
    for entry in entries:
        limb, _, link = entry.rpartition("=")
        limb = limb or PAIR[0]
        if limb in found or not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", limb):
            raise BadInput(
                f"--hand {entry}: the limb '{limb}' is named twice, or is no name (valid: LIMB=LINK)"
            )
        found[limb] = link
    if not copies:
        return found or {PAIR[0]: None}
    if len(found) > 1:
        raise BadInput("--hand: copies of one description have one hand (valid: --hand LINK, once)")
    hand = next(iter(found.values()), None)
    return dict.fromkeys(copies, hand)


def _bases(mirror: float | None, entries: tuple[str, ...]) -> dict[str, Base]:
    from impedance_modules.errors import BadInput

    if mirror is not None:
        if entries or not (math.isfinite(mirror) and mirror > 0.0):
            raise BadInput(f"--mirror {mirror:g}: a distance above 0 m, and without --base")
        y = 0.5 * mirror
        return {PAIR[0]: (0.0, -y, 0.0, 0.0, 0.0, 0.0), PAIR[1]: (0.0, y, 0.0, 0.0, 0.0, 0.0)}
    found: dict[str, Base] = {}
    for entry in entries:
        limb, _, text = entry.partition("=")
        try:
            numbers = [float(word) for word in text.split(",")]
        except ValueError:
            numbers = []
        fine = len(numbers) in (3, 6) and all(map(math.isfinite, numbers))
        if not fine or limb in found or not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", limb):
            raise BadInput(f"--base {entry}: not LIMB=X,Y,Z[,ROLL,PITCH,YAW] (valid: --base left=0,0.3,0)")
        x, y, z, roll, pitch, yaw = (*numbers, 0.0, 0.0, 0.0)[:6]
        found[limb] = (x, y, z, roll, pitch, yaw)
    return found


def _print(made: MadeRobot) -> None:
    for limb, joints in made.limbs.items():
        say(f"{limb}: {len(joints)} joints: {', '.join(joints)}")
    for note in made.notes:
        say(f"note: {note}")
    if made.assumed:
        say(f"assumed, to be filled in or confirmed: {', '.join(made.assumed)}")
    name = made.folder.name
    say(f"wrote {made.folder}/ (robot.yaml, {name}.urdf); next: impedance check TASK --robot {name}")
