# SPDX-License-Identifier: BSD-3-Clause
"""What of a damaged recording is intact: which parts or blocks are not, and how much the others hold.

A damaged recording is refused by whoever reads it (`refusal`), because a hole in it would be diagnosed as physics.
`save_intact` writes what is intact as episodes without holes; ``impedance import`` calls it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow as pa

from impedance_modules.episode.columns import TIME
from impedance_modules.episode.file_format import write_merged
from impedance_modules.episode.metadata import decode_metadata, encode_metadata
from impedance_modules.episode.run_folder import EPISODE, part_index, part_paths
from impedance_modules.episode.sealed_parquet import MAGIC, UNREADABLE, CheckedFile, Span, find_blocks
from impedance_modules.errors import BadInput
from impedance_modules.input_files import check_file

ROWS_AT_ONCE = 8192
"""Rows that are held in memory while all are looked at."""

MOST_PROBLEMS = 3
"""Problems that a message tells one by one."""


@dataclass(frozen=True)
class Piece:
    """Rows that are whole or lost together: one row group.

    Attributes:
        open: Opens the file that they are in.
        group: Number of the row group in it.
        first: Number of the first row in the recording; None where unknown, because of damage before it.
        rows: How many.
        times: Of the first and the last row [s].
    """

    open: Callable[[], CheckedFile]
    group: int
    first: int | None
    rows: int
    times: tuple[float, float]

    def tables(self) -> Iterator[pa.Table]:
        """Returns the rows."""
        return self.open().tables(self.group, ROWS_AT_ONCE)


@dataclass(frozen=True)
class Survey:
    """What is known of a recording after all of it has been read.

    Attributes:
        place: A file, or a run's directory.
        problems: What is damaged, in sentences without a full stop; none where all is intact.
        rows: How many were recorded; None where damage hides it.
        stretches: Intact pieces that follow each other without a hole.
    """

    place: Path
    problems: tuple[str, ...]
    rows: int | None
    stretches: tuple[tuple[Piece, ...], ...]

    @property
    def intact_rows(self) -> int:
        """Rows that can be saved."""
        return sum(piece.rows for stretch in self.stretches for piece in stretch)

    @property
    def seconds(self) -> float:
        """Length of the stretches together [s]."""
        return sum(stretch[-1].times[1] - stretch[0].times[0] for stretch in self.stretches)


class _Search:
    """Gathers pieces and problems in the order of the rows."""

    def __init__(self) -> None:
        self.problems: list[str] = []
        self.stretches: list[list[Piece]] = [[]]
        self.row: int | None = 0

    def hole(self, problem: str, rows: int | None) -> None:
        """Notes that rows are lost, None for an unknown number."""
        self.problems.append(problem)
        self.stretches.append([])
        self.row = None if rows is None or self.row is None else self.row + rows

    def take(self, opener: Callable[[], CheckedFile], name: str) -> None:
        """Takes every row group of a file that can be opened."""
        try:
            file = opener()
        except UNREADABLE as error:
            self.hole(f"{name}: {first_line(error)}", None)
            return
        for group in range(file.metadata.num_row_groups):
            rows = file.metadata.row_group(group).num_rows
            piece = Piece(opener, group, self.row, rows, (0.0, 0.0))
            try:
                self.stretches[-1].append(replace(piece, times=_times(piece)))
            except UNREADABLE as error:
                where = f"{name}, {_rows(self.row, rows)}" if self.row is not None else name
                self.hole(f"{where}: {first_line(error)}", rows)
                continue
            self.row = None if self.row is None else self.row + rows


def survey(path: Path) -> Survey:
    """Reads all of a recording, once.

    Args:
        path: An episode's file, or a run's directory.

    Raises:
        BadInput: No such file, or no regular one.
    """
    search = _Search()
    if not path.is_dir():
        check_file(path)
    if path.is_dir() and not (path / EPISODE).exists():
        _search_parts(path, search)
    else:
        _search_file(path / EPISODE if path.is_dir() else path, search)
    found = tuple(tuple(stretch) for stretch in search.stretches if stretch)
    return Survey(path, tuple(search.problems), search.row, found)


def refusal(path: Path, found: Survey) -> BadInput:
    """Returns the error that says what is damaged, what is intact, and how to save it."""
    told = "; ".join(found.problems[:MOST_PROBLEMS])
    more = len(found.problems) - MOST_PROBLEMS
    told += f"; and {more} more" if more > 0 else ""
    if not found.stretches and path.is_file() and not _begins_as_parquet(path):
        return BadInput(
            f"{path}: is no episode, it does not begin as a Parquet file does (valid: an episode as Parquet; tables"
            " and ROS recordings, with --map where they do not say what their columns mean, as 'impedance import'"
            " reads them)"
        )
    if not found.stretches:
        return BadInput(
            f"{path}: is damaged, nothing of it can be saved: {told} (valid: an episode as Parquet)"
        )
    of = "" if found.rows is None else f" of {found.rows}"
    holes = f" in {len(found.stretches)} stretches" if len(found.stretches) > 1 else ""
    return BadInput(
        f"{path}: is damaged: {told}. {found.intact_rows}{of} rows are intact, {found.seconds:.6g} s{holes}"
        f" (valid: a whole copy; 'impedance import {path} --out DIR' saves what is intact)"
    )


def save_intact(found: Survey, folder: Path, name: str) -> tuple[tuple[Path, str], ...]:
    """Writes every stretch of two rows or more as an episode ``NAME.parquet``, or ``NAME-1.parquet`` ... of several.

    Each says ``"complete": false`` and ``"saved"``: the number of its first row in the recording, null where
    unknown.

    Returns:
        The files, and a sentence about each.

    Raises:
        BadInput: Nothing is intact, or the metadata is wrong.
    """
    stretches = [stretch for stretch in found.stretches if sum(piece.rows for piece in stretch) > 1]
    if not stretches:
        raise refusal(found.place, found)
    saved = []
    for number, stretch in enumerate(stretches, start=1):
        target = folder / (f"{name}.parquet" if len(stretches) == 1 else f"{name}-{number}.parquet")
        if target.exists():
            raise BadInput(f"{found.place}: another source makes {target.name}, too (valid: one at a time)")
        schema = _schema_of_saved(stretch, str(found.place), target.stem)
        tables = (table for piece in stretch for table in piece.tables())
        write_merged(target, tables, schema)
        rows = _rows(stretch[0].first, sum(piece.rows for piece in stretch))
        saved.append((target, f"a damaged or unfinished recording: {rows} of it"))
    return tuple(saved)


def first_line(error: Exception) -> str:
    """Returns what an error of a library says, without its report of where in the library."""
    return str(error).strip().split("\n", maxsplit=1)[0].rstrip(".")


def _begins_as_parquet(path: Path) -> bool:
    """Whether a file begins so, or has been cut off before that can be told."""
    with path.open("rb") as file:
        return MAGIC.startswith(file.read(len(MAGIC)))


def _search_parts(directory: Path, search: _Search) -> None:
    following = 0
    for path in part_paths(directory):
        index = part_index(path)
        if index != following:
            search.hole(f"{path.name} does not follow on part {following - 1}", None)
        search.take(partial(CheckedFile, path), path.name)
        following = index + 1


def _search_file(path: Path, search: _Search) -> None:
    try:
        CheckedFile(path)
    except UNREADABLE as error:
        problem = f"{path.name} is not a whole Parquet file: {first_line(error)}"
    else:
        search.take(partial(CheckedFile, path), path.name)
        return
    # Its last footer is lost, and with it how many rows there were.
    search.problems.append(problem)
    end = 0
    for start, stop in _blocks(path):
        if start != end:
            search.hole(f"{path.name}: bytes {end} to {start}", None)
        search.take(partial(CheckedFile, path, (start, stop)), path.name)
        end = stop
    search.row = None


def _blocks(path: Path) -> tuple[Span, ...]:
    try:
        return tuple(find_blocks(path))
    except UNREADABLE:
        return ()  # a forged footer


def _times(piece: Piece) -> tuple[float, float]:
    """Reads all rows of a piece; returns the first and the last time [s], zeros where that is no number."""
    first = last = None
    for table in piece.tables():
        if TIME in table.schema.names and len(table):
            first = table[TIME][0].as_py() if first is None else first
            last = table[TIME][-1].as_py()
    return (first, last) if isinstance(first, float) and isinstance(last, float) else (0.0, 0.0)


def _schema_of_saved(stretch: tuple[Piece, ...], place: str, name: str) -> pa.Schema:
    schema = stretch[0].open().schema
    has_effort = any(column.startswith("effort.") for column in schema.names)
    metadata: dict[str, Any] = decode_metadata(schema.metadata, place, has_effort=has_effort)
    metadata |= {"complete": False, "episode": name, "saved": {"first_row": stretch[0].first}}
    return schema.with_metadata(encode_metadata(metadata, place))


def _rows(first: int | None, count: int) -> str:
    return f"{count} rows" if first is None else f"rows {first} to {first + count - 1}"
