# SPDX-License-Identifier: BSD-3-Clause
"""Verbs of ``impedance baxter`` that only listen: ``check``, ``state`` and ``record``."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from impedance_modules.cli.baxter.connection import node, robot_option, stop_request, transport_option
from impedance_modules.cli.plain_lines import say
from impedance_modules.errors import BadInput, RobotRefused

if TYPE_CHECKING:
    from rich.table import Table

    from impedance_modules.backends.baxter.session import Session
    from impedance_modules.backends.preflight import PreflightResult

ANSWERS = {True: "passed", False: "FAILED", None: "unknown"}


@click.command("check")
@robot_option
@transport_option
def check(robot: str, transport: str) -> int:
    """Check everything that must be true of a robot before a run may command it; listen only.

    Exit: 0 no check failed, 2 no robot or a check failed, with the remedy.
    """
    from impedance_modules.backends.baxter.session import Session
    from impedance_modules.cli.terminal import Terminal
    from impedance_modules.spec.robot_reader import read_robot

    with node(transport, "check") as found:
        session = Session(found, read_robot(robot))
        session.listen_to_grippers(session.electric_grippers())
        results = session.preflight(tuple(session.spec.limbs))
    Terminal().print(_results_table(results))
    failed = [result for result in results if result.passed is False]
    for result in failed:
        say(f"{result.name}: {result.found} (valid: {result.remedy})", err=True)
    return 2 if failed else 0


def _results_table(results: tuple[PreflightResult, ...]) -> Table:
    """One row per check."""
    from rich.table import Table
    from rich.text import Text

    table = Table(title="preflight checks", title_justify="left")
    for name in ("check", "", "found"):
        table.add_column(name, no_wrap=name != "found")
    for result in results:
        table.add_row(Text(result.name), ANSWERS[result.passed], Text(result.found))
    return table


@click.command("state")
@robot_option
@transport_option
def state(robot: str, transport: str) -> int:
    """Show power, joints, hands, cuffs and collisions of a robot; listen only.

    Exit: 0 shown, 2 no robot, or its arms say nothing.
    """
    from impedance_modules.backends.baxter.power import Power, describe
    from impedance_modules.backends.baxter.session import LISTENING, Session
    from impedance_modules.cli.terminal import Terminal
    from impedance_modules.spec.robot_reader import read_robot

    console = Terminal()
    with node(transport, "state") as found:
        power = describe(Power(found).wait())
        session = Session(found, read_robot(robot))
        time.sleep(LISTENING)
        console.print(f"power: {power}", highlight=False)
        console.print(f"states: {session.link.rate(time.monotonic()):.0f} Hz", highlight=False)
        for line in _of_limbs(session):
            console.print(line, highlight=False)
        console.print(_joints(session))
    return 0


def _of_limbs(session: Session) -> list[str]:
    lines = []
    for limb in session.model.limbs:
        parts = []
        if limb in session.link.endpoint:
            at = session.link.endpoint[limb].pose.position
            parts.append(f"gripper at ({at.x:.3f}, {at.y:.3f}, {at.z:.3f}) m")
        if limb in session.link.collision:
            parts.append("reports a collision" if session.link.collision[limb] else "reports no collision")
        if limb in session.link.squeezed:
            parts.append("cuff squeezed" if session.link.squeezed[limb] else "cuff free")
        lines.append(f"{limb}: {', '.join(parts) or 'says nothing'}")
    return lines


def _joints(session: Session) -> Table:
    from rich.table import Table

    sample = session.link.sample
    if sample is None:
        missing = ", ".join(session.link.merge.missing) or "some joints"
        raise RobotRefused(
            f"no complete state of the arms; never reported: {missing} (valid: 'baxter check')"
        )
    table = Table(title="joints", title_justify="left")
    for name in ("joint", "position [rad]", "range [rad]", "velocity [rad/s]", "effort [N.m]"):
        table.add_column(name, justify="left" if name == "joint" else "right")
    model, state = session.model, sample.state
    for i, (name, joint) in enumerate(zip(model.joint_names, model.joints, strict=True)):
        outside = not joint.position_min <= state.position[i] <= joint.position_max
        table.add_row(
            name,
            f"{state.position[i]:.4f}",
            f"{joint.position_min:.3f} .. {joint.position_max:.3f}{' OUTSIDE' * outside}",
            f"{state.velocity[i]:.3f}",
            f"{state.effort[i]:.2f}",
        )
    return table


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
def record(
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
    from impedance_modules.backends.baxter.baxter_recorder import RecordOptions, record_episode
    from impedance_modules.backends.baxter.session import Session
    from impedance_modules.backends.preflight import refuse_failed
    from impedance_modules.cli.terminal import Terminal
    from impedance_modules.spec.robot_reader import read_robot

    if duration is not None and not duration > 0.0:
        raise BadInput(f"--duration {duration:g}: a recording needs some time (valid: above 0 s)")
    directory = out if out is not None else Path("out") / f"baxter-{time.strftime('%Y%m%d-%H%M%S')}"
    with node(transport, "record") as found, stop_request() as asked_to_stop:
        session = Session(found, read_robot(robot))
        refuse_failed(session.preflight(tuple(session.model.limbs)), commanding=False)
        with Terminal().status("recording; Ctrl-C ends it") as status:
            episode = record_episode(
                session,
                RecordOptions(directory, duration, rate, repeat_of),
                lambda t: status.update(f"recording, {t:.1f} s; Ctrl-C ends it"),
                asked_to_stop,
            )
    say(f"recorded: {episode}")
    return 0
