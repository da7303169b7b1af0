# SPDX-License-Identifier: BSD-3-Clause
"""``impedance baxter state``: what a robot says of itself now. Sends nothing."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import click

from impedance_modules.cli.baxter.connection import node, robot_option, transport_option

if TYPE_CHECKING:
    from rich.table import Table

    from impedance_modules.backends.baxter.session import Session


@click.command("state")
@robot_option
@transport_option
def state(robot: str, transport: str) -> int:
    """Show power, joints, hands, cuffs and collisions of a robot; listen only.

    Exit: 0 shown, 2 no robot, or its arms say nothing.
    """
    from rich.console import Console

    from impedance_modules.backends.baxter.power import Power, describe
    from impedance_modules.backends.baxter.session import LISTENING, Session
    from impedance_modules.spec.robot_reader import read_robot

    console = Console()
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
            parts.append("feels a collision" if session.link.collision[limb] else "feels no collision")
        if limb in session.link.squeezed:
            parts.append("cuff squeezed" if session.link.squeezed[limb] else "cuff free")
        lines.append(f"{limb}: {', '.join(parts) or 'says nothing'}")
    return lines


def _joints(session: Session) -> Table:
    from rich.table import Table

    from impedance_modules.errors import RobotRefused

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
