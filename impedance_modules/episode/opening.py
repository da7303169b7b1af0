# SPDX-License-Identifier: BSD-3-Clause
"""Opens a directory for a new episode: makes it, locks it, and never overwrites what was recorded before."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from impedance_modules.episode.run_folder import EPISODE, RunLock, part_paths
from impedance_modules.errors import BadInput


def open_directory(directory: Path) -> RunLock:
    """Makes and locks a directory for one new episode.

    Raises:
        BadInput: It cannot be written, is being written, or holds recorded rows already.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        lock = RunLock.acquire(directory)
    except OSError as error:
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
