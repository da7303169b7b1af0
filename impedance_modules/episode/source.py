# SPDX-License-Identifier: BSD-3-Clause
"""Finds an episode's file, or the parts that a killed run left, and reads columns from either."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from impedance_modules.episode.run_folder import EPISODE, RunLock, part_paths
from impedance_modules.episode.file_format import merge_parts, read_parts
from impedance_modules.errors import BadInput

ReadColumn = Callable[[str], pa.ChunkedArray]


def open_source(path: Path) -> tuple[pa.Schema, int, ReadColumn]:
    """Opens an episode file or a run's directory.

    A directory with parts of a run that is over gets them merged first. Parts of a run that is still going,
    or in a directory that cannot be written, are read as they are.

    Returns:
        Its schema, its number of rows, and a function that reads one column.

    Raises:
        BadInput: Nothing there, empty, or not Parquet.
    """
    directory = path if path.is_dir() else path.parent
    if path.is_dir() or (path.name == EPISODE and not path.exists()):
        merged = _merge_if_over(directory) if part_paths(directory) else directory / EPISODE
        if merged is None:
            table = read_parts(directory)
            return table.schema, len(table), table.column
        if not merged.exists():
            raise BadInput(f"{path}: no episode here (valid: a directory with {EPISODE}, or a Parquet file)")
        path = merged
    return _open_file(path)


def _merge_if_over(directory: Path) -> Path | None:
    """Returns the episode that a finished run's parts make, or None if they must stay parts."""
    try:
        lock = RunLock.try_acquire(directory)
    except OSError:
        return None  # a read-only directory: nobody can be writing it, and neither can we
    if lock is None:
        return None
    try:
        return merge_parts(directory, None)
    finally:
        lock.release()


def _open_file(path: Path) -> tuple[pa.Schema, int, ReadColumn]:
    if not path.exists():
        raise BadInput(f"{path}: no such file (valid: an episode's Parquet file or a run's directory)")
    try:
        if path.stat().st_size == 0:
            raise BadInput(f"{path}: the file is empty (valid: an episode as Parquet)")
        # Columns are read one by one from a disk nearby: reading ahead would only hold memory.
        file = pq.ParquetFile(path, pre_buffer=False)
    except (pa.ArrowException, OSError) as error:
        raise BadInput(f"{path}: not a whole Parquet file: {error} (valid: an episode as Parquet)") from error

    def read(name: str) -> pa.ChunkedArray:
        try:
            return file.read(columns=[name], use_threads=False).column(0)
        except (pa.ArrowException, OSError) as error:
            raise BadInput(f"{path}: column '{name}' is damaged: {error}") from error

    return file.schema_arrow, file.metadata.num_rows, read
