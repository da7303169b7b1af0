# SPDX-License-Identifier: BSD-3-Clause
"""MATLAB's .mat, NumPy's .npz and other programs' Parquet files: variables, structs and matrices become columns."""

from __future__ import annotations

import math
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tokenize import TokenError
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from impedance_modules.episode.exact_numbers import (
    LARGEST_EXACT,
    exact_doubles,
    refuse_many_rows,
    too_large_whole,
)
from impedance_modules.episode.imports.matlab_file import LARGEST_CONTENT, NewerVersionError, read_variables
from impedance_modules.episode.imports.table import CHUNK_ROWS, Chunk, Vector, refuse_nonfinite
from impedance_modules.episode.sealed_parquet import UNREADABLE
from impedance_modules.errors import BadInput
from impedance_modules.input_files import check_file, open_input, read_input

LARGEST_FILE = 1_000_000_000
"""Bytes; these formats can only be read whole."""

_DEEPEST = 4
"""Structs within structs."""

_DAMAGE = (
    ValueError,
    TypeError,
    KeyError,
    IndexError,
    OverflowError,
    EOFError,
    MemoryError,
    RecursionError,
    NotImplementedError,
    SyntaxError,
    TokenError,
    RuntimeError,
    struct.error,
    zlib.error,
    zipfile.BadZipFile,
)


class ArrayTable:
    """The numeric variables of one file.

    A vector ``q`` is the column ``q``; of a matrix ``q`` the columns are ``q[1]``, ``q[2]`` ... along its shorter
    side; a field of a struct is ``s.q``.

    Attributes:
        path, names, scalars, row_word, notes: See `LogTable`.
    """

    def __init__(self, path: Path) -> None:
        """Reads the file.

        Raises:
            BadInput: Missing, damaged, too large, or without any series of numbers.
        """
        self.path = path
        self.row_word = "sample"
        self.notes: list[str] = []
        self._series: dict[str, Vector] = {}
        scalars: dict[str, float] = {}
        for name, value in _numeric(_variables(path), _DEEPEST):
            if value.size == 1:
                scalars[name] = float(value.reshape(-1)[0])
            elif value.size:
                self._series.update(_columns(name, value))
        self.scalars: Mapping[str, float] = scalars
        self.names = tuple(self._series)
        if not self.names:
            raise BadInput(f"{path}: no variable of it is a series of numbers (valid: vectors and matrices)")

    def chunks(self, wanted: Sequence[str]) -> Iterator[Chunk]:
        """Yields the wanted columns; see `LogTable`."""
        lengths = {name: len(self._series[name]) for name in wanted}
        if len(set(lengths.values())) > 1:
            listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise BadInput(
                f"{self.path}: variables of different lengths: {listed} (valid: one value per sample)"
            )
        for start in range(0, max(lengths.values(), default=0), CHUNK_ROWS):
            columns = {
                name: self._doubles(name, self._series[name][start : start + CHUNK_ROWS]) for name in wanted
            }
            count = len(next(iter(columns.values())))
            places = np.arange(start + 1, start + 1 + count, dtype=np.int64)
            yield refuse_nonfinite(self.path, self.row_word, Chunk(columns, places))

    def _doubles(self, name: str, values: Vector) -> Vector:
        if values.dtype.kind in "iu" and values.size and _largest(values) > LARGEST_EXACT:
            raise BadInput(f"{self.path}: {too_large_whole(name)}")
        return values.astype(np.float64)


class ParquetTable:
    """The numeric columns of one Parquet file.

    Attributes:
        path, names, scalars, row_word, notes: See `LogTable`.
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
            if check_file(path) == 0:
                raise BadInput(f"{path}: the file is empty (valid: Parquet)")
            self._file = pq.ParquetFile(path, page_checksum_verification=True)
            schema = self._file.schema_arrow
        except UNREADABLE as error:
            raise BadInput(f"{path}: not a whole Parquet file: {error}") from error
        refuse_many_rows(path, self._file.metadata.num_rows)
        self.names = tuple(field.name for field in schema if _is_number(field.type))
        self.metadata: Mapping[bytes, bytes] = schema.metadata or {}

    def chunks(self, wanted: Sequence[str]) -> Iterator[Chunk]:
        """Yields the wanted columns; see `LogTable`."""
        start = 1
        try:
            for batch in self._file.iter_batches(CHUNK_ROWS, columns=list(wanted), use_threads=False):
                columns = {
                    name: exact_doubles(self.path, name, batch.column(name)).to_numpy(zero_copy_only=False)
                    for name in wanted
                }
                places = np.arange(start, start + len(batch), dtype=np.int64)
                start += len(batch)
                yield refuse_nonfinite(self.path, self.row_word, Chunk(columns, places))
        except UNREADABLE as error:
            raise BadInput(f"{self.path}: damaged: {error}") from error


def _variables(path: Path) -> Mapping[str, Any]:
    try:
        if check_file(path, LARGEST_FILE) == 0:
            raise BadInput(f"{path}: the file is empty (valid: a .mat or .npz file)")
        return _load(path)
    except NewerVersionError as error:
        raise BadInput(f"{path}: {error} (valid: save it again with save(..., '-v7'))") from error
    except OSError as error:
        what = "damaged or cut off" if error.errno is None else "cannot be read"
        raise BadInput(f"{path}: {what}: {error}") from error
    except _DAMAGE as error:
        raise BadInput(f"{path}: damaged or cut off: {error}") from error


def _load(path: Path) -> Mapping[str, Any]:
    if path.suffix == ".npz":
        with open_input(path, LARGEST_FILE) as stream:
            _check_arrays(stream)
            stream.seek(0)
            with np.load(stream, allow_pickle=False) as archive:
                return {name: archive[name] for name in archive.files}
    return read_variables(read_input(path, LARGEST_FILE))


def _check_arrays(stream: BinaryIO) -> None:
    """Compares what the arrays of an .npz file say of their size with what the file holds, before they are made."""
    with zipfile.ZipFile(stream) as archive:
        if sum(member.file_size for member in archive.infolist()) > LARGEST_CONTENT:
            raise ValueError(f"unpacked, it has more than {LARGEST_CONTENT} bytes")
        for member in archive.infolist():
            if not member.filename.endswith(".npy"):
                continue
            with archive.open(member) as array:
                version = np.lib.format.read_magic(array)
                read = _HEADERS.get(version)
                if read is None:
                    raise ValueError(f"{member.filename} is of the unknown version {version}")
                shape, _, kind = read(array)
            if math.prod(shape) * kind.itemsize > member.file_size:
                raise ValueError(f"{member.filename} is cut off, or says that it is larger than it is")


_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def _largest(values: Vector) -> int:
    return max(int(values.max()), -int(values.min()))


def _numeric(variables: Mapping[str, Any], depth: int) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yields every real array under its dotted name."""
    for name, value in variables.items():
        if isinstance(value, Mapping):
            fields = {f"{name}.{field}": inner for field, inner in value.items()}
            if depth:
                yield from _numeric(fields, depth - 1)
            continue
        array = np.asarray(value)
        if array.dtype.kind in "fiub" and array.ndim <= 2:
            yield name, array


def _columns(name: str, value: NDArray[Any]) -> Iterator[tuple[str, Any]]:
    if value.ndim == 2 and min(value.shape) > 1:
        tall = value if value.shape[0] >= value.shape[1] else value.T
        yield from ((f"{name}[{index + 1}]", tall[:, index]) for index in range(tall.shape[1]))
    else:
        yield name, value.reshape(-1)


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind))
