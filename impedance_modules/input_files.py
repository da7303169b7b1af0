# SPDX-License-Identifier: BSD-3-Clause
"""The one way in which files that somebody gave are opened: regular files only, and no larger than is stated.

A device never ends and a FIFO never begins, so both are refused before a byte of them is read. What a library opens
by its path (Parquet, bags, MATLAB's files) is looked at by ``check_file`` before.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from impedance_modules.errors import BadInput

_KINDS = (
    (stat.S_ISDIR, "a directory"),
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def check_file(path: Path, largest: int | None = None, *, near: str = "") -> int:
    """Makes sure that a path leads to a regular file.

    Args:
        path: As the user wrote it.
        largest: Bytes that it may have; None for files that are read piece by piece.
        near: What to add where there is no such file, e.g. which files lie beside it.

    Returns:
        Its size [bytes].

    Raises:
        BadInput: It is missing, no regular file, too large, or nobody may look at it.
    """
    try:
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        raise BadInput(f"{path}: no such file{near}") from None
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from None
    return _size(path, status, largest)


@contextmanager
def open_input(path: Path, largest: int | None = None, *, near: str = "") -> Iterator[BinaryIO]:
    """Opens a regular file for reading; arguments and errors as in ``check_file``."""
    check_file(path, largest, near=near)
    try:
        # Should the name mean a FIFO by now, this does not wait for somebody to write into it.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        raise _unreadable(path, error) from None
    with os.fdopen(descriptor, "rb") as stream:
        _size(path, os.fstat(descriptor), largest)
        yield stream


def read_input(path: Path, largest: int, *, near: str = "") -> bytes:
    """Reads a whole regular file; arguments and errors as in ``check_file``."""
    try:
        with open_input(path, largest, near=near) as stream:
            raw = stream.read(largest + 1)
    except OSError as error:
        raise _unreadable(path, error) from None
    if len(raw) > largest:
        raise BadInput(f"{path}: grows while it is read; at most {largest} bytes are read")
    return raw


def is_file(path: Path) -> bool:
    """Says whether a path leads to a regular file; a name that no file can have leads nowhere."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _size(path: Path, status: os.stat_result, largest: int | None) -> int:
    if not stat.S_ISREG(status.st_mode):
        kind = next((words for test, words in _KINDS if test(status.st_mode)), "no regular file")
        raise BadInput(f"{path}: is {kind}, not a file (valid: a regular file)")
    if largest is not None and status.st_size > largest:
        raise BadInput(f"{path}: {status.st_size} bytes; at most {largest} are read")
    return status.st_size


def _unreadable(path: Path, error: Exception) -> BadInput:
    return BadInput(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}")
