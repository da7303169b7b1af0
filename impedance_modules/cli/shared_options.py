# SPDX-License-Identifier: BSD-3-Clause
"""Arguments and options that several verbs share."""

from __future__ import annotations

from pathlib import Path

import click

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

arm_option = click.option("--arm", metavar="NAME", help="Use only this arm.")
