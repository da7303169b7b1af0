# SPDX-License-Identifier: BSD-3-Clause
"""Options that the verbs of ``impedance baxter`` share, and a node for as long as a verb needs one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
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
    """Brings a node up and takes it down, whatever happens in between.

    Ctrl-C, SIGTERM and a closed terminal unwind everything; while the master is told, it takes three.
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


class StopRequest:
    """Remembers that somebody asked for the end while it is entered."""

    def __init__(self) -> None:
        self._asked = False
        self._listening = handled_by(self._ask)

    def asked(self) -> bool:
        """Says whether somebody did."""
        return self._asked

    def __enter__(self) -> StopRequest:
        """Starts to listen."""
        self._listening.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Gives the signals back."""
        self._listening.__exit__(kind, error, trace)

    def _ask(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002 - the signal module's signature
        self._asked = True
