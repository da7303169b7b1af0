# SPDX-License-Identifier: BSD-3-Clause
"""Ctrl-C and SIGTERM as a wish, for verbs that must end tidily."""

from __future__ import annotations

import signal
from types import FrameType, TracebackType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Ending:
    """Remembers that somebody asked for the end while it is entered."""

    def __init__(self) -> None:
        self._asked = False
        self._before = {number: signal.getsignal(number) for number in SIGNALS}

    def asked(self) -> bool:
        """Says whether somebody did."""
        return self._asked

    def __enter__(self) -> Ending:
        """Starts to listen."""
        for number in SIGNALS:
            signal.signal(number, self._ask)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Gives the signals back."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _ask(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002 - the signal module's signature
        self._asked = True
