# SPDX-License-Identifier: BSD-3-Clause
"""Columns of a file as float64, which holds whole numbers exactly up to 2^53; and how many rows are read at all."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa

from impedance_modules.errors import BadInput

LARGEST_EXACT = 1 << 53

MOST_ROWS = 1 << 28
"""Rows of one recording, three days at 1 kHz: 2 GB for each column that is read. A file of a kilobyte can say more."""


def too_large_whole(name: str) -> str:
    """Says that a column's whole numbers would be rounded."""
    return (
        f"column '{name}' holds whole numbers beyond 2^53, which a double rounds"
        " (valid: smaller ones; of stamps in nanoseconds, take the first from all)"
    )


def exact_doubles(
    place: Path | str, name: str, values: pa.Array | pa.ChunkedArray
) -> pa.Array | pa.ChunkedArray:
    """Returns a column of numbers as float64.

    Raises:
        BadInput: Whole numbers that a double would round, or no numbers.
    """
    try:
        return values.cast(pa.float64())
    except pa.ArrowInvalid as error:
        if pa.types.is_integer(values.type):
            raise BadInput(f"{place}: {too_large_whole(name)}") from error
        raise


def refuse_many_rows(place: Path | str, rows: int) -> None:
    """Makes sure that a recording's columns fit into memory.

    Raises:
        BadInput: They may not.
    """
    if rows > MOST_ROWS:
        raise BadInput(f"{place}: {rows} rows (valid: at most {MOST_ROWS}; split the recording)")
