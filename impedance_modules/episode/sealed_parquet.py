# SPDX-License-Identifier: BSD-3-Clause
"""Parquet in which damage is found, and what is whole beside it can still be read.

A file is a row of blocks and a last footer::

    PAR1 pages footer length PAR1 | PAR1 pages footer length PAR1 | ... | footer of all pages, length PAR1

Each block is a whole Parquet file of one row group, so it can be read by itself. A stock reader reads the last footer
and sees one ordinary file; what lies between its pages does not concern it. Where a file is cut off, or its last
footer is damaged, the blocks remain.

Parquet's own checksums leave out footers and the headers of pages: one wrong bit there gives wrong numbers. So every
footer has a seal, under the key `SEAL`: a digest of the footer itself (SHA-256), then a CRC-32 of all bytes of every
column of every row group. Files of other programs have none, and are read all the same.
"""

from __future__ import annotations

import hashlib
import io
import os
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from mmap import ACCESS_READ, mmap
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

import pyarrow as pa
import pyarrow.parquet as pq

SEAL = b"impedance_modules.seal"
"""Key of a footer's seal: hexadecimal digits, 64 of the digest and 8 for each column of each row group. The digest is
computed with zeros in its place."""

LONGEST_FOOTER = 1 << 28
"""What a longer one is said to be is damage [bytes]; that of 150 columns and ten hours at 1 kHz has 50 MB."""

UNREADABLE = (pa.ArrowException, OSError, ValueError)
"""What opening or reading a damaged file raises: names that are no text, too, and an empty file."""

MAGIC = b"PAR1"
_LENGTH = 4
"""Bytes that say how long a footer is, before the magic that ends a file."""
_END = _LENGTH + len(MAGIC)
_DIGEST, _CHECKSUM = 64, 8
"""Digits of them."""
_AT_ONCE = 1 << 20
"""Bytes that are read from the disk for a checksum."""

Span = tuple[int, int]
"""First byte, and last + 1."""


class BlockFile:
    """Writes tables of one schema to a new file, each as a block; the last footer at the end of ``with``."""

    def __init__(self, stream: BinaryIO, schema: pa.Schema, **encoding: Any) -> None:
        """Begins.

        Args:
            stream: A file just opened to be written and read (``w+b``).
            schema: Of all tables.
            **encoding: `pyarrow.parquet.ParquetWriter`'s.
        """
        self._stream, self._encoding = stream, encoding
        # What is written past the writer, through the same sink, is counted in the offsets that it notes.
        self._sink = pa.PythonFile(stream, "w")
        self._writer = _writer(self._sink, schema, encoding)
        self._checksums: list[bytes] = []

    def write(self, table: pa.Table) -> None:
        """Appends one block."""
        if self._checksums:
            self._sink.write(MAGIC)
        self._writer.write_table(table, row_group_size=len(table))
        # The same pages again, for the footer of a file that holds nothing else.
        alone = encode_block(table, **self._encoding)
        footer = _footer_before(_from(alone), len(alone))
        self._checksums.append(_checksums_in(footer, _parse(footer)))
        self._sink.write(alone[-_END - len(footer) :])

    def __enter__(self) -> BlockFile:
        """Returns itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Completes the file, or gives it up after an exception."""
        try:
            if error is None:
                _note(self._writer, b"".join(self._checksums))
                self._writer.close()
                self._stream.flush()
                self._seal()
        finally:
            # Else pyarrow completes the file when it collects the writer, whatever has become of the stream.
            self._writer.is_open = False

    def _seal(self) -> None:
        file = self._stream.fileno()
        size = os.fstat(file).st_size
        footer = _footer_before(lambda first, stop: os.pread(file, stop - first, first), size)
        os.pwrite(file, _with_digest(footer), size - _END - len(footer))


class CheckedFile:
    """A Parquet file, or a block of one, whose bytes are compared with their checksums before they are read.

    Attributes:
        schema: Of its table.
        metadata: What its footer says.
    """

    def __init__(self, path: Path, span: Span | None = None) -> None:
        """Opens a file, or the block that `find_blocks` found at ``span``.

        Raises:
            One of `UNREADABLE`: It is not whole.
        """
        self._path = path
        self._start, stop = span or (0, path.stat().st_size)
        footer = _footer_before(self._bytes, stop - self._start)
        if SEAL in footer and not _is_intact(footer):
            raise pa.ArrowInvalid("its footer is not what was written: the checksum differs")
        source = path if span is None else pa.BufferReader(self._bytes(0, stop - self._start))
        # Columns are read one by one from a disk nearby: reading ahead would only hold memory.
        self._file = pq.ParquetFile(source, pre_buffer=False, page_checksum_verification=True)
        self.schema, self.metadata = self._file.schema_arrow, self._file.metadata
        self._checksums = _checksums_in(footer, self.metadata) if SEAL in footer else b""

    def column(self, name: str) -> pa.ChunkedArray:
        """Reads one column.

        Raises:
            One of `UNREADABLE`: It is damaged.
        """
        for group in range(self._file.num_row_groups):
            self._check(group, [self.schema.names.index(name)])
        return self._file.read(columns=[name], use_threads=False).column(0)

    def tables(self, group: int, rows: int) -> Iterator[pa.Table]:
        """Yields a row group, at most ``rows`` rows at once.

        Raises:
            One of `UNREADABLE`: It is damaged.
        """
        self._check(group, range(len(self.schema.names)))
        if self.metadata.row_group(group).num_rows <= rows:
            yield self._file.read_row_group(group, use_threads=False)
            return
        for batch in self._file.iter_batches(rows, row_groups=[group], use_threads=False):
            yield pa.Table.from_batches([batch], schema=self.schema)

    def _bytes(self, first: int, stop: int) -> bytes:
        with self._path.open("rb", buffering=0) as stream:
            return _read(stream, self._start, first, stop)

    def _check(self, group: int, columns: Iterable[int]) -> None:
        """Compares the bytes of columns with their checksums, where the file has any."""
        if not self._checksums:
            return
        said, names = self.metadata.row_group(group), self.schema.names
        with self._path.open("rb", buffering=0) as stream:
            for number in columns:
                at = _CHECKSUM * (group * len(names) + number)
                found = _checksum(partial(_read, stream, self._start), said.column(number))
                if found != self._checksums[at : at + _CHECKSUM]:
                    raise pa.ArrowInvalid(f"column '{names[number]}' is damaged: the checksum differs")


def encode_block(table: pa.Table, **encoding: Any) -> bytes:
    """Returns a table as a file of one block, without a call into Python: a control loop keeps running meanwhile."""
    sink = pa.BufferOutputStream()
    width = len(table.schema.names)
    with _writer(sink, table.schema, encoding) as writer:
        writer.write_table(table, row_group_size=max(1, len(table)))
        _note(writer, b"0" * (width * _CHECKSUM))
    data: bytes = sink.getvalue().to_pybytes()
    footer = _footer_before(_from(data), len(data))
    group = _parse(footer).row_group(0)
    found = b"".join(_checksum(_from(data), group.column(number)) for number in range(width))
    at = _place(footer) + _DIGEST
    footer = _with_digest(footer[:at] + found + footer[at + len(found) :])
    return data[: -_END - len(footer)] + footer + data[-_END:]


def find_blocks(path: Path) -> Iterator[Span]:
    """Searches a file for blocks whose footers are intact."""
    after = 0
    with path.open("rb") as stream, mmap(stream.fileno(), 0, access=ACCESS_READ) as content:
        place = content.find(MAGIC, len(MAGIC))
        while place >= 0:
            stop = place + len(MAGIC)
            footer = _footer_before(_from(content), stop)
            if SEAL in footer and _is_intact(footer):
                start = stop - _END - len(footer) - _end_of_pages(footer)
                # Alone, the last footer would begin where no block does.
                if start == after or (start > after and content[start : start + len(MAGIC)] == MAGIC):
                    yield start, stop
                    after = stop
            place = content.find(MAGIC, stop)


def _writer(sink: pa.NativeFile, schema: pa.Schema, encoding: Mapping[str, Any]) -> pq.ParquetWriter:
    return pq.ParquetWriter(sink, schema, write_statistics=False, write_page_checksum=True, **encoding)


def _note(writer: pq.ParquetWriter, checksums: bytes) -> None:
    writer.add_key_value_metadata({SEAL.decode(): (b"0" * _DIGEST + checksums).decode()})


def _read(stream: io.FileIO, start: int, first: int, stop: int) -> bytes:
    stream.seek(start + first)
    return stream.read(stop - first)


def _from(content: bytes | mmap) -> Callable[[int, int], bytes]:
    return lambda first, stop: content[first:stop]


def _footer_before(read: Callable[[int, int], bytes], stop: int) -> bytes:
    """Returns the footer of a file that would end at ``stop``; nothing where there cannot be one."""
    end = read(max(0, stop - _END), stop)
    length = int.from_bytes(end[:_LENGTH], "little")
    if end[_LENGTH:] != MAGIC or length > min(LONGEST_FOOTER, stop - _END):
        return b""
    return read(stop - _END - length, stop - _END)


def _parse(footer: bytes) -> pq.FileMetaData:
    tail = footer + len(footer).to_bytes(_LENGTH, "little") + MAGIC
    return pq.read_metadata(pa.BufferReader(MAGIC + tail))


def _span(column: pq.ColumnChunkMetaData) -> Span:
    """Returns where the pages of a column of a row group are."""
    first = column.dictionary_page_offset if column.has_dictionary_page else column.data_page_offset
    return first, first + column.total_compressed_size


def _end_of_pages(footer: bytes) -> int:
    """Returns where the pages end in a file of one row group that has this footer."""
    group = _parse(footer).row_group(0)
    return max(_span(group.column(number))[1] for number in range(group.num_columns))


def _checksum(read: Callable[[int, int], bytes], column: pq.ColumnChunkMetaData) -> bytes:
    found, (first, stop) = 0, _span(column)
    for place in range(first, stop, _AT_ONCE):
        found = zlib.crc32(read(place, min(place + _AT_ONCE, stop)), found)
    return f"{found:08x}".encode()


def _place(footer: bytes) -> int:
    """Returns where the seal stands: after its key, a byte for the type and its length, seven bits to a byte."""
    place = footer.rindex(SEAL) + len(SEAL) + 1
    while footer[place] & 0x80:
        place += 1
    return place + 1


def _with_digest(footer: bytes) -> bytes:
    """Returns a footer with its digest."""
    at = _place(footer)
    head, tail = footer[:at], footer[at + _DIGEST :]
    return head + hashlib.sha256(head + b"0" * _DIGEST + tail).hexdigest().encode() + tail


def _is_intact(footer: bytes) -> bool:
    try:
        return _with_digest(footer) == footer
    except IndexError:  # nothing stands where the seal should
        return False


def _checksums_in(footer: bytes, said: pq.FileMetaData) -> bytes:
    """Returns the checksums of a seal, one row group after the other."""
    at = _place(footer) + _DIGEST
    return footer[at : at + _CHECKSUM * said.num_columns * said.num_row_groups]
