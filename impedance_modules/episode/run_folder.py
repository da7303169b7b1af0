# SPDX-License-Identifier: BSD-3-Clause
"""The files of a run: their names, how they are written and locked, and which episodes a path stands for."""

from __future__ import annotations

import fcntl
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from impedance_modules.errors import BadInput, NotRecorded

EPISODE = "episode.parquet"
RECORDING = "recording.rrd"
SUMMARY = "summary.json"
PICTURE = "picture.png"
LOCK = ".episode.lock"
PART_PATTERN = "episode.part-*.parquet"


def part_path(directory: Path, index: int) -> Path:
    """Returns the path of a run's part number ``index``, counted from 0."""
    return directory / f"episode.part-{index:05d}.parquet"


def part_paths(directory: Path) -> tuple[Path, ...]:
    """Returns the parts in ``directory`` in the order they were written."""
    found = [path for path in directory.glob(PART_PATTERN) if path.stem.rpartition("-")[2].isdecimal()]
    return tuple(sorted(found, key=part_index))


def part_index(path: Path) -> int:
    """Returns the number of a part."""
    return int(path.stem.rpartition("-")[2])


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """Writes a file that either appears whole under its name or not at all.

    The bytes go to a hidden temporary name in the same directory, reach the disk (fsync), and take their name
    in one atomic step. An error in between leaves nothing; a kill leaves at most the hidden file, which goes when
    the directory is read (`remove_temporaries`).
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        with _open_locked(temporary) as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
            temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _open_locked(path: Path) -> BinaryIO:
    """Opens a file that `remove_temporaries` leaves alone as long as it is open."""
    while True:
        stream = path.open("w+b")
        fcntl.flock(stream, fcntl.LOCK_SH)
        # Whoever removed it between our open and our lock: then make a new one.
        if path.exists() and path.stat().st_ino == os.fstat(stream.fileno()).st_ino:
            return stream
        stream.close()


def remove_temporaries(directory: Path) -> None:
    """Removes what a kill left of files that `whole_file` had not finished; those of a living process stay.

    Raises:
        OSError: The directory cannot be written.
    """
    for pattern in (PART_PATTERN, EPISODE, SUMMARY, PICTURE):
        for temporary in directory.glob(f".{pattern}.tmp"):
            with suppress(FileNotFoundError, BlockingIOError), temporary.open("rb") as stream:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
                temporary.unlink()


@contextmanager
def recorded(path: Path) -> Iterator[None]:
    """Ends a run with a reason where one of its files cannot be written.

    Args:
        path: Of the file, or of the run's directory.

    Raises:
        NotRecorded: The disk is full, say.
    """
    try:
        yield
    except OSError as error:
        raise NotRecorded(
            f"{path}: cannot be written: {error.strerror or error} (valid: a disk with free space)"
        ) from error


class RunLock:
    """Held by the process that writes a directory; the kernel releases it however the process ends."""

    def __init__(self, descriptor: int, path: Path) -> None:
        self._descriptor = descriptor
        self._path = path

    @classmethod
    def try_acquire(cls, directory: Path) -> RunLock | None:
        """Returns the lock, or None while another process (or writer) holds it.

        Raises:
            OSError: The directory cannot be written.
        """
        path = directory / LOCK
        while True:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(descriptor)
                return None
            # Whoever held it may have removed the file between our open and our lock: then take the new one.
            if path.exists() and path.stat().st_ino == os.fstat(descriptor).st_ino:
                return cls(descriptor, path)
            os.close(descriptor)

    @classmethod
    def acquire(cls, directory: Path) -> RunLock:
        """Returns the lock.

        Raises:
            BadInput: Another run is writing in the directory.
        """
        lock = cls.try_acquire(directory)
        if lock is None:
            raise BadInput(f"{directory}: another run is writing here (valid: another --out directory)")
        return lock

    def release(self) -> None:
        """Removes the lock file and releases the lock."""
        self._path.unlink(missing_ok=True)
        os.close(self._descriptor)


def write_summary(directory: Path, summary: Mapping[str, Any]) -> Path:
    """Writes the summary of a run, whole or not at all.

    Args:
        directory: Of the run.
        summary: Numbers, texts, arrays, nested; a number that is not finite becomes null.

    Raises:
        TypeError: A value that is none of these.
        NotRecorded: It cannot be written.
    """
    path = Path(directory) / SUMMARY
    text = json.dumps(_plain(summary), indent=2, allow_nan=False, ensure_ascii=False)
    with recorded(path), whole_file(path) as stream:
        stream.write(text.encode() + b"\n")
    return path


def episode_paths(paths: Sequence[Path]) -> tuple[Path, ...]:
    """Replaces every folder of imported episodes by its episodes, in the order of their names.

    Files and runs' directories stay as they are, and so does a path that leads nowhere: whoever reads it says so.

    Raises:
        BadInput: A folder without any episode.
    """
    return tuple(found for path in paths for found in _episodes_at(path))


def the_episode(path: Path) -> Path:
    """Returns the one episode that a path stands for.

    Raises:
        BadInput: A folder with several episodes, or with none.
    """
    found = episode_paths([path])
    if len(found) > 1:
        names = ", ".join(str(episode) for episode in found[:5]) + (", ..." if len(found) > 5 else "")
        raise BadInput(f"{path}: holds {len(found)} episodes (valid: one of them: {names})")
    return found[0]


def _episodes_at(path: Path) -> Sequence[Path]:
    if not path.is_dir() or (path / EPISODE).exists() or part_paths(path):
        return [path]
    found = sorted(file for file in path.glob("*.parquet") if not file.name.startswith("."))
    if not found:
        raise BadInput(
            f"{path}: no episode here (valid: a run's directory with {EPISODE}, or a folder of episodes,"
            " NAME.parquet each)"
        )
    return found


def _plain(value: Any) -> Any:
    """Returns the value in JSON's own types."""
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value
