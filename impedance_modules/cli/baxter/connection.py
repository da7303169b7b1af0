# SPDX-License-Identifier: BSD-3-Clause
"""What the verbs of ``impedance baxter`` share: options, a node for as long as a verb needs it, requests to stop."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

from impedance_modules.control.signals import handled_by

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
    """Opens a node and closes it, whatever happens in between.

    Ctrl-C, SIGTERM and a closed terminal end the verb; while the node unregisters, it takes three of them.
    """
    from impedance_modules.backends.baxter.ros.rospy_transport import connect
    from impedance_modules.control.signals import as_interrupt, stubborn

    with as_interrupt():
        transport = connect(kind, purpose)
        try:
            yield transport
        finally:
            with stubborn():
                transport.close()


@contextmanager
def stop_request() -> Iterator[Callable[[], bool]]:
    """Turns Ctrl-C, SIGTERM and SIGHUP into a request; gives a function that says whether there was one."""
    signals: list[int] = []
    with handled_by(lambda number, frame: signals.append(number)):  # noqa: ARG005 - the signal module's signature
        yield lambda: bool(signals)
