# SPDX-License-Identifier: BSD-3-Clause
"""Options of ``run`` that say where a robot is reached: a connection file, addresses, what may be done at the start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from impedance_modules.errors import BadInput

if TYPE_CHECKING:
    from impedance_modules.spec.connection_file import ConnectionSpec, FrankaConnection, Ros2Connection
    from impedance_modules.spec.robot_spec import RobotSpec

CONNECTED = ("franka", "ros2")
"""Backends that are reached by a connection file."""


def connection_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Adds the options to a command."""
    for option in (
        click.option(
            "--recover",
            is_flag=True,
            help="Ask a Franka robot that a reflex has stopped for its automatic error recovery first.",
        ),
        click.option(
            "--address",
            multiple=True,
            metavar="[LIMB=]HOST",
            help="Address of a Franka robot; once per limb.",
        ),
        click.option(
            "--connection",
            type=click.Path(path_type=Path),
            metavar="FILE",
            help="Where the robots are reached (schemas/connection.schema.json).",
        ),
    ):
        command = option(command)
    return command


@dataclass(frozen=True)
class Reached:
    """Where the user says that robots are reached.

    Attributes:
        connection: A connection file, or None.
        addresses: As given with --address.
        recover: Whether automatic error recovery is asked for.
    """

    connection: Path | None = None
    addresses: tuple[str, ...] = ()
    recover: bool = False

    def refuse_unused(self, backend: str) -> None:
        """Refuses options that the backend does not know.

        Raises:
            BadInput: With each of them.
        """
        given = [
            (self.connection is not None, "--connection", CONNECTED),
            (bool(self.addresses), "--address", ("franka",)),
            (self.recover, "--recover", ("franka",)),
        ]
        unused = [
            f"{option}: --backend {backend} does not use it (valid: {', '.join(backends)})"
            for asked, option, backends in given
            if asked and backend not in backends
        ]
        if unused:
            raise BadInput("\n".join(unused))

    def of_franka(self, robot: RobotSpec) -> FrankaConnection:
        """How Franka arms are reached: the connection file's part, with the addresses of the options.

        Raises:
            BadInput, BadFile: No address, or a file or option that cannot be read.
        """
        from impedance_modules.spec.connection_file import FrankaConnection

        spec = self._read()
        part = None if spec is None else spec.franka
        if spec is not None and part is None and not self.addresses:
            raise BadInput(f"{self.connection}: has no part 'franka' (valid: franka: {{addresses: ...}})")
        addresses = {} if part is None else dict(part.addresses)
        addresses.update(self._given(tuple(robot.limbs)))
        return FrankaConnection(addresses) if part is None else replace(part, addresses=addresses)

    def of_ros2(self) -> Ros2Connection:
        """How a robot on ROS 2 is reached.

        Raises:
            BadInput, BadFile: No connection file, or one that cannot be read or has no part for it.
        """
        spec = self._read()
        if spec is None or spec.ros2 is None:
            raise BadInput(
                f"--backend ros2: {'no connection file' if spec is None else f'{self.connection} has no part ros2'}, so"
                " neither topics nor who carries the arm's weight are known (valid: --connection FILE with ros2:"
                " {gravity: ..., controllers: ...}, docs/ros2.md)"
            )
        return spec.ros2

    def _read(self) -> ConnectionSpec | None:
        from impedance_modules.spec.connection_file import read_connection

        return None if self.connection is None else read_connection(self.connection)

    def _given(self, limbs: tuple[str, ...]) -> dict[str, str]:
        """Limb -> address of --address; without a limb it is that of the only one."""
        found: dict[str, str] = {}
        for entry in self.addresses:
            limb, _, host = entry.rpartition("=")
            if not limb and len(limbs) == 1:
                limb = limbs[0]
            if not limb or not host:
                raise BadInput(f"--address {entry}: not LIMB=HOST (valid: --address {limbs[0]}=172.16.0.2)")
            if limb in found:
                raise BadInput(f"--address {entry}: '{limb}' has an address already (valid: one per limb)")
            found[limb] = host
        return found


NOWHERE = Reached()
"""Of a run whose backend needs no connection."""
