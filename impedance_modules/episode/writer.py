# SPDX-License-Identifier: BSD-3-Clause
"""Writes an episode while the run goes on: rows are copied to memory, and a thread writes them to part files."""

from __future__ import annotations

import errno
import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from impedance_modules.episode.background import Background, RowRing
from impedance_modules.episode.columns import PHASE, TIME, parse_columns
from impedance_modules.episode.file_format import episode_schema, merge_parts, rows_to_table, write_part
from impedance_modules.episode.metadata import check_metadata
from impedance_modules.episode.run_folder import EPISODE, RunLock, part_path, part_paths, recorded
from impedance_modules.errors import BadInput, NotRecorded

FLUSH_PERIOD = 0.5
"""Wall time, and episode time, after which rows are on their way to a part [s]."""

LONGEST_LAG = 0.8
"""Episode time that a run which may wait lets pass before its rows are on disk [s]."""


class EpisodeWriter:
    """Records a run so that a kill -9 loses at most its last second.

    `append` copies one row into a ring; a thread writes what is new to a part file (fsync, atomic rename) at
    least every `FLUSH_PERIOD` of wall time and of episode time. `close` merges the parts into
    ``episode.parquet``.

    Attributes:
        directory: Where the episode goes.
        background: The thread, for other slow work of the same run (the rerun recording).
    """

    def __init__(
        self,
        directory: Path,
        columns: Sequence[str],
        metadata: Mapping[str, Any],
        *,
        wait_for_disk: bool,
    ) -> None:
        """Opens ``directory`` for one episode.

        Args:
            directory: Made if missing. An episode that is already there is never overwritten.
            columns: Column names, ``time`` first; ``phase``, if present, is text and no part of a row.
            metadata: From `episode_metadata`; until `close` the files also say ``"complete": false``.
            wait_for_disk: True for a simulation, which may run faster than the disk and then waits for it;
                False for a robot, whose loop never waits (a stalled disk may then cost more than the last
                second).

        Raises:
            BadInput: The directory holds an episode or is being written, or columns or metadata are wrong.
        """
        self.directory = Path(directory)
        self._columns = tuple(columns)
        self._metadata = dict(metadata)
        self._check_columns()
        self._schema = episode_schema(self._columns, self._checked({"complete": False}), str(self.directory))
        width = len(self._columns) - (PHASE in self._columns)
        self._shape = (width,)
        self._ring = RowRing(width)
        self._phase_codes: dict[str | None, int] = {None: -1}
        self._wait_for_disk = wait_for_disk
        self._wake_time = -math.inf
        self._last_time_allowed = math.inf
        self._parts = 0
        self._failure: OSError | pa.ArrowException | None = None
        self._closed = False
        self._lock = open_directory(self.directory)
        self.background = Background(FLUSH_PERIOD)
        self.background.register(self._drain)

    @property
    def rows(self) -> int:
        """Rows appended so far."""
        return self._ring.received

    def append(self, row: NDArray[np.float64], phase: str | None = None) -> None:
        """Records one sample; about a microsecond, and never a wait on a robot.

        Args:
            row: (columns without ``phase``,) in the order of ``columns``. NaN means no value in a column that
                need not have one.
            phase: Name of the phase, or None.

        Raises:
            BadInput: A row of another shape, or a phase where no ``phase`` column was declared.
            NotRecorded: The recording cannot be written (disk full ...); on a robot also: the disk has been stuck
                for so long that rows would be lost.
        """
        if row.shape != self._shape:
            raise BadInput(
                f"{self.directory}: row of shape {row.shape} (valid: {self._shape}, one per column)"
            )
        now = row[0]
        if now > self._last_time_allowed or self._ring.full:
            self._wait(now)
        code = self._phase_codes.get(phase)
        self._ring.put(row, self._new_phase(phase) if code is None else code)
        if now >= self._wake_time:
            self._wake(now)

    def close(self, **final_metadata: Any) -> Path:
        """Writes what is left, merges the parts, and marks the episode complete. May be called twice.

        Args:
            **final_metadata: Added to the metadata, e.g. why the run ended.

        Returns:
            Path of the episode.

        Raises:
            BadInput: Nothing was recorded, or the metadata is wrong.
            NotRecorded: The recording could not be written; what was written before stays as parts, and is read
                as it is.
        """
        if self._closed:
            return self.directory / EPISODE
        self._closed = True
        try:
            self.background.stop()
            self._check_disk()
            if self.rows == 0:
                raise BadInput(f"{self.directory}: nothing was recorded, so there is no episode to write")
            return self._merge(self._checked({**final_metadata, "complete": True}))
        finally:
            self._lock.release()

    def abandon(self) -> None:
        """Gives the directory back without an episode; rows so far stay as parts, as after a kill."""
        if self._closed:
            return
        self._closed = True
        try:
            self.background.stop()
        finally:
            self._lock.release()

    def __enter__(self) -> EpisodeWriter:
        """Returns itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Closes; after an exception, which goes on, the metadata names it (``ended_by``)."""
        if error is None:
            self.close()
        elif self.rows:
            self.close(ended_by=type(error).__name__)
        else:
            self.abandon()

    def _merge(self, metadata: Mapping[str, Any]) -> Path:
        try:
            with recorded(self.directory / EPISODE):
                return merge_parts(self.directory, metadata)
        except BadInput as damage:
            raise NotRecorded(f"{self.directory}: the parts cannot be merged: {damage}") from damage

    def _check_columns(self) -> None:
        place = f"{self.directory}: columns of a new episode"
        parse_columns(self._columns, place)
        if self._columns[0] != TIME:
            raise BadInput(f"{place}: '{self._columns[0]}' comes first (valid: 'time' first)")

    def _checked(self, more: Mapping[str, Any]) -> dict[str, Any]:
        """Returns the episode's metadata with more keys, or raises BadInput."""
        metadata = {**self._metadata, **more}
        has_effort = any(name.startswith("effort.") for name in self._columns)
        check_metadata(metadata, str(self.directory), has_effort=has_effort)
        return metadata

    def _new_phase(self, phase: str | None) -> int:
        if PHASE not in self._columns:
            raise BadInput(f"{self.directory}: phase '{phase}' without a 'phase' column (valid: declare it)")
        return self._phase_codes.setdefault(phase, len(self._phase_codes) - 1)

    def _wake(self, now: float) -> None:
        """Has the thread write what is new; the first row only starts the clock."""
        self._wake_time = now + FLUSH_PERIOD
        if self.rows > 1:
            self._check_disk()
            self.background.wake()
        elif self._wait_for_disk:
            self._last_time_allowed = now + LONGEST_LAG

    def _wait(self, now: float) -> None:
        """Lets a simulation that has outrun the disk wait for it; stops a robot rather than lose rows."""
        if not self._wait_for_disk:
            raise NotRecorded(
                f"{self.directory}: the disk has not taken a row for too long; the record would be lost"
            )
        while self._ring.full or (now > self._last_time_allowed and not self._ring.empty):
            self._check_disk()
            self.background.wake()
            time.sleep(0.0005)

    def _check_disk(self) -> None:
        self.background.check()
        if self._failure is not None:
            raise NotRecorded(
                f"{self.directory}: the recording cannot be written: {self._failure}"
                f" (valid: a disk with free space; {self._ring.released} rows are safe)"
            ) from self._failure

    def _drain(self, last: bool) -> None:  # noqa: ARG002 - every round is the same to a part file
        """Writes every new row as one part; runs in the thread."""
        if self._ring.empty or self._failure is not None:
            return
        rows, codes = self._ring.peek()
        phases = [phase for phase in tuple(self._phase_codes) if phase is not None]
        try:
            table = rows_to_table(self._schema, rows, codes, phases, self.background.pause)
            write_part(part_path(self.directory, self._parts), table)
        except (OSError, pa.ArrowException) as failure:
            self._failure = failure
            return
        self._parts += 1
        self._ring.release(len(rows))
        if self._wait_for_disk:
            self._last_time_allowed = float(rows[-1, 0]) + LONGEST_LAG


def open_directory(directory: Path) -> RunLock:
    """Makes and locks a directory for one new episode.

    Raises:
        BadInput: It cannot be written, is being written, or holds recorded rows already.
        NotRecorded: The disk is full.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        lock = RunLock.acquire(directory)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise NotRecorded(f"{directory}: cannot be written: {error.strerror}") from error
        raise BadInput(
            f"{directory}: cannot be written: {error} (valid: a new or empty directory)"
        ) from error
    try:
        _refuse_episode(directory)
    except BadInput:
        lock.release()
        raise
    return lock


def _refuse_episode(directory: Path) -> None:
    """Raises if rows were recorded here before; clears away files without any."""
    for path in (directory / EPISODE, *part_paths(directory)):
        if not path.exists():
            continue
        try:
            rows = pq.read_metadata(path).num_rows
        except (pa.ArrowException, OSError) as error:
            raise BadInput(f"{path}: already there and unreadable: {error} (valid: another --out)") from error
        if rows:
            raise BadInput(
                f"{path}: already holds {rows} recorded rows (valid: another --out directory, or remove it)"
            )
        path.unlink()
