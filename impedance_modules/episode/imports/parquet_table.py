# SPDX-License-Identifier: BSD-3-Clause
"""A Parquet file of another program, read batch by batch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from impedance_modules.episode.imports.table import CHUNK_ROWS, Chunk, refuse_nonfinite
from impedance_modules.errors import BadInput


class ParquetTable:
    """The numeric columns of one Parquet file.

    Attributes:
        path, names, scalars, row_word, notes: See `Table`.
    """

    def __init__(self, path: Path) -> None:
        """Opens the file.

        Raises:
            BadInput: Missing, empty, cut off, or no Parquet.
        """
        self.path = path
        self.scalars: Mapping[str, float] = {}
        self.row_word = "sample"
        self.notes: list[str] = []
        try:
            if path.stat().st_size == 0:
                raise BadInput(f"{path}: the file is empty (valid: Parquet)")
            self._file = pq.ParquetFile(path)
        except FileNotFoundError:
            raise BadInput(f"{path}: no such file") from None
        except (pa.ArrowException, OSError) as error:
            raise BadInput(f"{path}: not a whole Parquet file: {error}") from error
        schema = self._file.schema_arrow
        self.names = tuple(field.name for field in schema if _is_number(field.type))
        self.metadata: Mapping[bytes, bytes] = schema.metadata or {}

    def chunks(self, wanted: Sequence[str]) -> Iterator[Chunk]:
        """Yields the wanted columns; see `Table`."""
        start = 1
        try:
            for batch in self._file.iter_batches(CHUNK_ROWS, columns=list(wanted), use_threads=False):
                columns = {
                    name: batch.column(name).cast(pa.float64()).to_numpy(zero_copy_only=False)
                    for name in wanted
                }
                places = np.arange(start, start + len(batch), dtype=np.int64)
                start += len(batch)
                yield refuse_nonfinite(self.path, self.row_word, Chunk(columns, places))
        except (pa.ArrowException, OSError) as error:
            raise BadInput(f"{self.path}: damaged: {error}") from error


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind))
