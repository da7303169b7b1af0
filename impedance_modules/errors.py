# SPDX-License-Identifier: BSD-3-Clause
"""One exception tree. Every message says what is wrong, where, and what would be valid.

The command line turns each class into one exit code, so a caller never parses text.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_UNPRINTABLE = re.compile(
    "[\x00-\x08\x0a-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)
"""Control characters, those that turn the direction of text, and halves of characters."""


def printable(text: str, *, lines: bool = False) -> str:
    r"""Returns a text in which nothing commands a terminal: ESC becomes the four characters ``\x1b``.

    Args:
        text: May hold names that somebody else chose.
        lines: Leaves ends of lines as they are; without it they are written out, too.
    """

    def written_out(found: re.Match[str]) -> str:
        sign = found.group()
        return sign if lines and sign == "\n" else sign.encode("unicode_escape").decode("ascii")

    return _UNPRINTABLE.sub(written_out, text)


@dataclass(frozen=True, order=True)
class Problem:
    """One thing wrong in one file, at one place.

    Attributes:
        file: Path of the file as the user wrote it.
        line: Line, counted from 1.
        column: Column, counted from 1.
        path: Place inside the document, e.g. ``arms.right.springs[0].frame``.
        message: What is wrong, in a sentence.
        valid: What would be accepted; empty when the message already says it.
    """

    file: Path
    line: int
    column: int
    path: str
    message: str
    valid: tuple[str, ...] = ()

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}:{self.column}: "
        where = f"{self.path}: " if self.path else ""
        choices = f" (valid: {', '.join(self.valid)})" if self.valid else ""
        return printable(f"{place}{where}{self.message}{choices}")


class ImpedanceError(Exception):
    """Root of every error this package raises on purpose."""

    exit_code = 2

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process gets the same error, whatever its class is made of."""
        return _again, (type(self), self.args, self.__dict__)


def _again(kind: type[ImpedanceError], words: tuple[Any, ...], rest: Mapping[str, Any]) -> ImpedanceError:
    error = kind.__new__(kind, *words)
    error.__dict__.update(rest)
    return error


class BadInput(ImpedanceError):
    """A file, option or recording that cannot be used; nothing has moved."""


class BadFile(BadInput):
    """One or more located problems in a task, robot or patch file, all at once."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems: tuple[Problem, ...] = tuple(sorted(set(problems)))
        super().__init__("\n".join(str(problem) for problem in self.problems))


class SafetyStop(ImpedanceError):
    """A run was stopped by a safety rule or a phase that was not met."""

    exit_code = 3


class NotRecorded(SafetyStop):
    """A file of a run cannot be written, as on a full disk; what was written before can be read as it is."""


class RobotRefused(ImpedanceError):
    """A real robot must not be moved now; nothing has been sent. Says every reason and its remedy."""


class RobotStopped(ImpedanceError):
    """A robot, or what watches it, has ended torque control by itself; ``event`` is of ``safety.stop_levels``."""

    exit_code = 3

    def __init__(self, event: str, detail: str) -> None:
        self.event, self.detail = event, detail
        super().__init__(detail)


class PlantNotFinite(RobotStopped):
    """A number of the simulated robot's state has become infinite or NaN: nothing after it would be true."""

    def __init__(self, detail: str) -> None:
        super().__init__("plant_not_finite", detail)


class ReplayMismatch(ImpedanceError):
    """A recomputed torque differs from the recorded one."""

    exit_code = 4


class WorkerLost(ImpedanceError):
    """A process that computed a part of a result has ended before it was there; there is no result."""


class EndOfRecording(ImpedanceError):
    """A recorded robot has no further state."""


class NotConnected(ImpedanceError):
    """A backend was used before it was started or after it was stopped."""

    exit_code = 2


def nearest(name: str, valid: Sequence[str]) -> str:
    """Returns a ``; did you mean ...?`` clause for the closest valid name, or nothing."""
    matches = difflib.get_close_matches(name, valid, n=1, cutoff=0.5)
    return f"; did you mean '{matches[0]}'?" if matches else ""
