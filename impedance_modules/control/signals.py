# SPDX-License-Identifier: BSD-3-Clause
"""The three ways in which a person ends a program: Ctrl-C, SIGTERM, and closing its terminal (SIGHUP)."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

Handler = Callable[[int, FrameType | None], object] | int | None


def endings() -> tuple[signal.Signals, ...]:
    """Lists the signals that ask for the end; not SIGHUP where ``nohup`` has asked to ignore it."""
    unless = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return (signal.SIGINT, signal.SIGTERM) if unless else (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def handled_by(handler: Handler) -> Iterator[None]:
    """Has all of them call ``handler`` (number, frame) meanwhile."""
    before = {number: signal.getsignal(number) for number in endings()}
    try:
        for number in before:
            signal.signal(number, handler)
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


@contextmanager
def as_interrupt() -> Iterator[None]:
    """Has each raise KeyboardInterrupt, so that everything is undone on the way out."""
    with handled_by(signal.default_int_handler):
        yield


@contextmanager
def stubborn(times: int = 2) -> Iterator[None]:
    """Ignores the first few, for the moments in which things are undone; the next one interrupts all the same."""
    left = times

    def ignore(number: int, frame: FrameType | None) -> None:
        nonlocal left
        left -= 1
        if left < 0:
            signal.default_int_handler(number, frame)

    with handled_by(ignore):
        yield
