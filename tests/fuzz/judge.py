# SPDX-License-Identifier: BSD-3-Clause
"""How an input may end: it is read, or refused with a reason. Everything else is a finding.

A finding is an exception that is not the package's own, a reader that takes more than ``LONGEST`` seconds, one that
takes more than ``MOST_MEMORY`` bytes beyond what the process had, a file that is written, moved or removed outside the
folder for results, and a program, a connection or a pickle that an input has opened.
"""

from __future__ import annotations

import os
import resource
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from impedance_modules.errors import BadInput
from tests.fuzz.readers import Reader

LONGEST = 60.0
"""For one input [s]."""

MOST_MEMORY = 512 << 20
"""By which the process may grow over all its inputs [bytes]."""

ADDRESS_SPACE = 6 << 30
"""Of the whole process [bytes]: a library that wants more gets a MemoryError, and the machine goes on."""

_WRITES = {"os.mkdir": 0, "os.rename": 1, "os.remove": 0, "os.rmdir": 0, "os.symlink": 1, "os.link": 1}
"""Audit event -> which of its arguments is the path that changes."""
_NEVER = (
    "os.system",
    "subprocess.Popen",
    "os.exec",
    "os.posix_spawn",
    "pickle.find_class",
    "socket.connect",
    "socket.bind",
)


class Hang(BaseException):
    """An input takes too long; no reader may catch it."""


@dataclass(frozen=True)
class Verdict:
    """How one input ended: ``read``, ``refused``, or what is wrong."""

    ending: str
    problem: str = ""


class Watch:
    """Notes what the readers do outside their folder, as long as one runs."""

    def __init__(self) -> None:
        self.allowed: tuple[str, ...] = ()
        self.seen: list[str] = []
        sys.addaudithook(self._hook)

    def _hook(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self.allowed:
            return
        if event in _NEVER:
            self.seen.append(f"{event} {arguments!r:.200}")
        elif event == "open" and isinstance(arguments[2], int) and arguments[2] & (os.O_WRONLY | os.O_RDWR):
            self._note(event, arguments[0])
        elif event in _WRITES and not _in_open_folder(arguments):
            self._note(event, arguments[_WRITES[event]])

    def _note(self, event: str, path: object) -> None:
        if isinstance(path, str | bytes | os.PathLike):
            place = os.path.abspath(os.fsdecode(path))
            if not place.startswith(self.allowed) and not place.startswith("/dev/null"):
                self.seen.append(f"{event} {place}")


def _in_open_folder(arguments: tuple[Any, ...]) -> bool:
    """Whether a path is relative to a descriptor: so are those of a folder that is removed with all that is in it."""
    return isinstance(arguments[-1], int) and arguments[-1] >= 0


_WATCH: list[Watch] = []


def judge(reader: Reader, data: bytes) -> Verdict:
    """Feeds one input to a reader, in a folder of its own, and says how it ended."""
    if not _WATCH:
        _WATCH.append(Watch())
    before = memory()
    with _folder() as folder:
        given, out, scratch = (folder / name for name in ("in", "out", "tmp"))
        for place in (given, out, scratch):
            place.mkdir()
        path = given / f"log{reader.suffix(data)}"
        path.write_bytes(data)
        with _watched(folder, scratch) as seen:
            verdict = _fed(reader, path, out)
    if seen:
        return Verdict("outside", "; ".join(seen[:3]))
    if verdict.ending in ("read", "refused") and memory() - before > MOST_MEMORY:
        return Verdict("memory", f"{(memory() - before) >> 20} MB more than before")
    return verdict


def _fed(reader: Reader, path: Path, out: Path) -> Verdict:
    try:
        with _in_time(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            reader.read(path, out)
    except BadInput as error:
        return Verdict("refused") if str(error) else Verdict("silent", "refused without a word")
    except Hang:
        return Verdict("hang", f"more than {LONGEST:g} s")
    except Exception as error:  # noqa: BLE001 - any other exception is what is looked for
        return Verdict("exception", f"{type(error).__name__}: {error!s:.200} ({_place(error)})")
    return Verdict("read")


def _place(error: Exception) -> str:
    """The innermost line of the package that an exception went through."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "/impedance_modules/" in frame.filename] or frames
    return f"{Path(own[-1].filename).name}:{own[-1].lineno}"


@contextmanager
def _in_time() -> Iterator[None]:
    def over(_number: int, _frame: FrameType | None) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, over)
    signal.setitimer(signal.ITIMER_REAL, LONGEST)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def _watched(folder: Path, scratch: Path) -> Iterator[list[str]]:
    """Also sends temporary files to a folder of the input's own."""
    watch, before = _WATCH[0], tempfile.tempdir
    watch.seen, watch.allowed, tempfile.tempdir = [], (str(folder),), str(scratch)
    try:
        yield watch.seen
    finally:
        watch.allowed, tempfile.tempdir = (), before


@contextmanager
def _folder() -> Iterator[Path]:
    shared = Path("/dev/shm")
    folder = Path(tempfile.mkdtemp(prefix="fuzz-", dir=shared if shared.is_dir() else None))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def memory() -> int:
    """Returns the most that the process has had [bytes]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10


def limit_memory() -> None:
    """Bounds this process; for a process of its own only."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, resource.getrlimit(resource.RLIMIT_AS)[1]))
