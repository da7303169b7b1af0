# SPDX-License-Identifier: BSD-3-Clause
"""``impedance baxter check``: may a run command this robot now? Sends nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from impedance_modules.cli.baxter.connection import node, robot_option, transport_option

if TYPE_CHECKING:
    from rich.table import Table

    from impedance_modules.backends.baxter.gates_types import Gate

ANSWERS = {True: "open", False: "CLOSED", None: "unknown"}


@click.command("check")
@robot_option
@transport_option
def check(robot: str, transport: str) -> int:
    """Ask a robot everything that must be true before a run may command it; listen only.

    Exit: 0 every gate is open or the robot does not tell, 2 no robot or a gate is closed, with the remedy.
    """
    from rich.console import Console

    from impedance_modules.backends.baxter.session import Session
    from impedance_modules.spec.robot_reader import read_robot

    with node(transport, "check") as found:
        gates = Session(found, read_robot(robot)).gates(tuple(read_robot(robot).limbs))
    console = Console()
    console.print(gate_table(gates))
    closed = [gate for gate in gates if gate.passed is False]
    for gate in closed:
        click.echo(f"{gate.name}: {gate.found} (valid: {gate.remedy})", err=True)
    return 2 if closed else 0


def gate_table(gates: tuple[Gate, ...]) -> Table:
    """Puts every gate into a line."""
    from rich.table import Table
    from rich.text import Text

    table = Table(title="gates", title_justify="left")
    for name in ("gate", "", "found"):
        table.add_column(name, no_wrap=name != "found")
    for gate in gates:
        table.add_row(Text(gate.name), ANSWERS[gate.passed], Text(gate.found))
    return table
