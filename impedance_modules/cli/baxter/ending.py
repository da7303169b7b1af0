# SPDX-License-Identifier: BSD-3-Clause
"""Ctrl-C, SIGTERM and SIGHUP as a wish, for verbs that must end tidily."""

from __future__ import annotations

from types import FrameType, TracebackType

from impedance_modules.control.signals import handled_by


class Ending:
    """Remembers that somebody asked for the end while it is entered."""

    def __init__(self) -> None:
        self._asked = False
        self._listening = handled_by(self._ask)

    def asked(self) -> bool:
        """Says whether somebody did."""
        return self._asked

    def __enter__(self) -> Ending:
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
