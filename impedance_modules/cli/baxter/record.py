# SPDX-License-Identifier: BSD-3-Clause
"""``impedance baxter record``: write down what a robot does while somebody else moves it."""

from __future__ import annotations

import time
from pathlib import Path

import click

from impedance_modules.cli.baxter.connection import node, robot_option, transport_option
from impedance_modules.errors import BadInput


@click.command("record")
@robot_option
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="DIR", help="Directory  [default: out/baxter-TIME]."
)
@click.option("--duration", type=float, metavar="S", help="End after this time  [default: on Ctrl-C].")
@click.option(
    "--rate",
    type=click.IntRange(1, 1000),
    metavar="HZ",
    help="Ask the robot for its states at this rate  [default: take what comes, send nothing].",
)
@click.option("--repeat-of", metavar="NAME", help="Episode that this one repeats.")
@transport_option
def record_robot(
    robot: str,
    out: Path | None,
    duration: float | None,
    rate: int | None,
    repeat_of: str | None,
    transport: str,
) -> int:
    """Record an episode that 'diagnose' reads: states, and the torques that the robot says it adds by itself.

    Exit: 0 recorded, 2 no robot, or its states are unfit, or stop coming.
    """
    from rich.console import Console

    from impedance_modules.backends.baxter.baxter_recorder import RecordOptions, record
    from impedance_modules.backends.baxter.preflight_checks import refuse_closed
    from impedance_modules.backends.baxter.session import Session
    from impedance_modules.cli.baxter.ending import Ending
    from impedance_modules.spec.robot_reader import read_robot

    if duration is not None and not duration > 0.0:
        raise BadInput(f"--duration {duration:g}: a recording needs some time (valid: above 0 s)")
    directory = out if out is not None else Path("out") / f"baxter-{time.strftime('%Y%m%d-%H%M%S')}"
    with node(transport, "record") as found, Ending() as ending:
        session = Session(found, read_robot(robot))
        refuse_closed(session.gates(tuple(session.model.limbs)), commanding=False)
        with Console().status("recording; Ctrl-C ends it") as status:
            episode = record(
                session,
                RecordOptions(directory, duration, rate, repeat_of),
                lambda t: status.update(f"recording, {t:.1f} s; Ctrl-C ends it"),
                ending.asked,
            )
    click.echo(f"recorded: {episode}")
    return 0
