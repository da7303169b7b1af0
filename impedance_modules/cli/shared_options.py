# SPDX-License-Identifier: BSD-3-Clause
"""Arguments and options that several verbs share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import click

from impedance_modules.errors import BadInput

task_argument = click.argument("task", metavar="TASK")

effects_option = click.option(
    "--effects",
    type=click.Path(path_type=Path),
    metavar="PATCH",
    help="Patch whose effects are applied to plant and model.",
)

compensate_option = click.option(
    "--compensate",
    type=click.Path(path_type=Path),
    metavar="PATCH",
    help="Patch whose effects the controller compensates.",
)

rate_option = click.option("--rate", type=float, metavar="HZ", help="Control rate  [default: the robot's].")

scale_option = click.option(
    "--scale",
    type=float,
    default=1.0,
    show_default=True,
    metavar="S",
    help="Multiply stiffness, damping and forces; above 0, up to 1.",
)

robot_option = click.option(
    "--robot",
    metavar="NAME",
    help="Robot to run on, instead of the task's: a name or a folder; for tasks that name no joints.",
)

arm_option = click.option("--arm", metavar="NAME", help="Use only this arm.")


def held_positions(entries: Sequence[str]) -> dict[str, float]:
    """Reads ``JOINT=POSITION`` of each --hold.

    Returns:
        Joint -> position [rad] ([m] if it slides).

    Raises:
        BadInput: One has another form, no finite number, or a joint that stands in another one.
    """
    found: dict[str, float] = {}
    for entry in entries:
        joint, _, text = entry.rpartition("=")
        try:
            position = float(text)
        except ValueError:
            position = math.nan
        if not joint or not math.isfinite(position):
            raise BadInput(f"--hold {entry}: not JOINT=POSITION with a number (valid: --hold torso=0.2)")
        if joint in found:
            raise BadInput(f"--hold {entry}: '{joint}' is held twice (valid: once)")
        found[joint] = position
    return found
