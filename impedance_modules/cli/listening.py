# SPDX-License-Identifier: BSD-3-Clause
"""``impedance run --listen``: where set-points come from, and when they cannot."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from rich.console import Console

    from impedance_modules.control.assembly import Assembly
    from impedance_modules.control.set_point_source import SetPointSource


class AskedToListen(Protocol):
    """The options of a run that matter here: backend, recording that is fed back, place to listen at."""

    @property
    def backend(self) -> str:
        """Its name."""

    @property
    def log(self) -> Path | None:
        """Recording that is the robot."""

    @property
    def listen(self) -> str | None:
        """Host and port; None for nowhere."""


def refuse_listening(assembly: Assembly, asked: AskedToListen) -> None:
    """Refuses ``--listen`` where no phase of the task listens, or a recording is fed back.

    Raises:
        BadInput: Naming what would be valid.
    """
    from impedance_modules.errors import BadInput

    if asked.listen is None:
        return
    if assembly.task.set_points is None:
        raise BadInput(
            f"--listen: task '{assembly.task.name}' has no 'set_points', the limits of what may arrive (valid: a task"
            " with 'set_points' and phases with 'listen: true', as the shipped task follow-set-points)"
        )
    if asked.backend == "replay":
        raise BadInput(
            "--listen: a recording that is fed back follows the set-points in it (valid: another backend)"
        )


def set_points_of(
    assembly: Assembly, asked: AskedToListen, closing: ExitStack, console: Console
) -> SetPointSource | None:
    """Opens where set-points come from; None for nowhere."""
    limits = assembly.task.set_points
    if limits is None:
        return None
    if asked.listen is None and asked.log is None:
        console.print(
            "nobody is listened to: the targets of 'set_points' rest (valid: --listen)", highlight=False
        )
        return None
    if asked.log is not None:
        from impedance_modules.episode.reader import read_episode
        from impedance_modules.runs.recorded_set_points import RecordedSetPoints

        return RecordedSetPoints(read_episode(asked.log), limits)
    from impedance_modules.streaming.inbox import Inbox
    from impedance_modules.streaming.receiver import SetPointReceiver, listening_address

    inbox = Inbox(limits)
    address = listening_address(str(asked.listen))
    closing.callback(SetPointReceiver(address, inbox).close)
    console.print(f"listening to set-points at {address}", highlight=False)
    return inbox
