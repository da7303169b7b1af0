# SPDX-License-Identifier: BSD-3-Clause
"""Options that the verbs of ``impedance baxter`` share, and a node for as long as a verb needs one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from impedance_modules.backends.baxter.ros.transport import Transport

transport_option = click.option(
    "--transport",
    type=click.Choice(["auto", "rospy", "sockets"]),
    default="auto",
    show_default=True,
    help="rospy, or plain sockets without any ROS install; auto takes rospy where it is.",
)

robot_option = click.option(
    "--robot", default="baxter", show_default=True, metavar="NAME", help="Robot folder."
)


@contextmanager
def node(kind: str, purpose: str) -> Iterator[Transport]:
    """Brings a node up and takes it down, whatever happens in between.

    Ctrl-C, SIGTERM and a closed terminal unwind everything; while the master is told, it takes three.
    """
    from impedance_modules.backends.baxter.ros.choose import connect
    from impedance_modules.control.signals import as_interrupt, stubborn

    with as_interrupt():
        transport = connect(kind, purpose)
        try:
            yield transport
        finally:
            with stubborn():
                transport.close()
