# SPDX-License-Identifier: BSD-3-Clause
"""What every kind of log looks like to the import: named columns of numbers, read in pieces.

A `Chunk` has the log's own columns and units, a `Block` the episode's.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from impedance_modules.episode.imports.import_map import Reference
from impedance_modules.errors import BadInput, nearest

CHUNK_ROWS = 32_768
"""Rows that are in memory at once: 8 MB of 30 columns."""

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Chunk:
    """Consecutive rows.

    Attributes:
        columns: Name -> (rows,).
        places: (rows,) number of each row as a person would look it up: line, sample or message.
    """

    columns: Mapping[str, Vector]
    places: NDArray[np.int64]

    def __len__(self) -> int:
        """Returns the number of rows."""
        return len(self.places)


@dataclass(frozen=True, eq=False)
class Block:
    """Consecutive samples.

    Attributes:
        time: (rows,) [s].
        columns: Episode column without ``time`` -> (rows,).
        places: (rows,) line, sample or message of each, for messages.
    """

    time: Vector
    columns: Mapping[str, Vector]
    places: NDArray[np.int64]


class LogTable(Protocol):
    """A log of one kind or another.

    Attributes:
        path: As the user wrote it.
        names: Columns that it offers.
        scalars: Variables that hold a single number.
        row_word: What a row is called: ``line``, ``sample``, ``message``.
        notes: What the reader should know, in sentences; complete once the rows were read.
    """

    path: Path
    names: tuple[str, ...]
    scalars: Mapping[str, float]
    row_word: str
    notes: list[str]

    def chunks(self, wanted: Sequence[str]) -> Iterator[Chunk]:
        """Yields the wanted columns from the first row to the last.

        Raises:
            BadInput: A row that cannot be read, or a value that is not a finite number.
        """
        ...  # pragma: no cover - a protocol's body never runs


def find_column(table: LogTable, reference: Reference) -> str:
    """Returns the name of a column.

    Raises:
        BadInput: The table has no such column.
    """
    if isinstance(reference, int):
        if reference > len(table.names):
            raise BadInput(f"{table.path}: no column number {reference} (it has {len(table.names)} columns)")
        return table.names[reference - 1]
    if reference not in table.names:
        near = nearest(reference, table.names)
        raise BadInput(f"{table.path}: no column '{reference}'{near} (present: {list_names(table.names)})")
    return reference


def list_names(names: Sequence[str], most: int = 24) -> str:
    """Returns the first names of many, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return (", ".join(names[:most]) or "none") + more


def refuse_nonfinite(path: Path, row_word: str, chunk: Chunk) -> Chunk:
    """Returns the chunk.

    Raises:
        BadInput: A value is NaN or infinite.
    """
    for name, values in chunk.columns.items():
        bad = ~np.isfinite(values)
        if bad.any():
            row = int(np.argmax(bad))
            raise BadInput(
                f"{path}:{chunk.places[row]}: column '{name}' is {values[row]} in this {row_word}"
                " (valid: finite numbers; cut the log there, or leave the column out)"
            )
    return chunk


def even_chunks(chunks: Iterable[Chunk], rows: int) -> Iterator[Chunk]:
    """Cuts a table anew, so that the pieces of several tables match: ``rows`` in each but the last."""
    held: list[Chunk] = []
    for chunk in chunks:
        held.append(chunk)
        while sum(map(len, held)) >= rows:
            whole = _join(held)
            yield _cut(whole, 0, rows)
            held = [_cut(whole, rows, len(whole))]
    rest = _join(held) if held else None
    if rest is not None and len(rest):
        yield rest


def _join(chunks: Sequence[Chunk]) -> Chunk:
    if len(chunks) == 1:
        return chunks[0]
    columns = {name: np.concatenate([c.columns[name] for c in chunks]) for name in chunks[0].columns}
    return Chunk(columns, np.concatenate([c.places for c in chunks]))


def _cut(chunk: Chunk, start: int, stop: int) -> Chunk:
    return Chunk(
        {name: values[start:stop] for name, values in chunk.columns.items()}, chunk.places[start:stop]
    )
