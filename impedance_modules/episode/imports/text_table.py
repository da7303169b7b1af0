# SPDX-License-Identifier: BSD-3-Clause
"""Text tables: values between commas, semicolons, tabs or blanks, read a few thousand lines at a time."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from impedance_modules.episode.imports.import_map import TextLayout
from impedance_modules.episode.imports.table import CHUNK_ROWS, Chunk, refuse_nonfinite
from impedance_modules.errors import BadInput
from impedance_modules.input_files import open_input

SEPARATORS: Mapping[str, str | None] = {"comma": ",", "semicolon": ";", "tab": "\t", "whitespace": None}
LONGEST_LINE = 1_000_000
"""Characters; a longer line is no table."""

_UNFINISHED = (
    "the last line has no line end: if the recorder was cut off there, its last value may be cut too"
)

Line = tuple[int, str]


class TextTable:
    """One text file.

    Attributes:
        path, names, scalars, row_word, notes: See `LogTable`; without a header the names are the numbers.
    """

    def __init__(self, path: Path, layout: TextLayout) -> None:
        """Reads the header.

        Raises:
            BadInput: Missing, empty, no text, or no rows.
        """
        self.path = path
        self.scalars: Mapping[str, float] = {}
        self.row_word = "line"
        self.notes: list[str] = []
        self._layout = layout
        self._separator = SEPARATORS[layout.separator]
        with open_text(path) as stream:
            self.names = self._read_names(stream)

    def chunks(self, wanted: Sequence[str]) -> Iterator[Chunk]:
        """Yields the wanted columns; see `LogTable`."""
        indices = [self.names.index(name) for name in wanted]
        with open_text(self.path) as stream:
            lines = self._data_lines(stream)
            while block := list(itertools.islice(lines, CHUNK_ROWS)):
                numbers = self._numbers(block, indices)
                columns = {name: numbers[:, i].copy() for i, name in enumerate(wanted)}
                places = np.array([number for number, _ in block], dtype=np.int64)
                yield refuse_nonfinite(self.path, self.row_word, Chunk(columns, places))

    def _read_names(self, stream: TextIO) -> tuple[str, ...]:
        lines = self._lines(stream)
        first = next(lines, None)
        if first is None:
            raise BadInput(f"{self.path}: the file is empty (valid: a table of numbers)")
        fields = self._fields(first[1])
        if not self._layout.header:
            return tuple(str(index + 1) for index in range(len(fields)))
        if next(lines, None) is None:
            raise BadInput(f"{self.path}: a header and no rows (valid: at least two samples)")
        names = tuple(field.strip() for field in fields)
        twice = sorted({name for name in names if name and names.count(name) > 1})
        if twice:
            raise BadInput(f"{self.path}:{first[0]}: the column '{twice[0]}' stands twice in the header")
        return names

    def _data_lines(self, stream: TextIO) -> Iterator[Line]:
        return itertools.islice(self._lines(stream), int(self._layout.header), None)

    def _lines(self, stream: TextIO) -> Iterator[Line]:
        """Yields the lines that count with their numbers; the sign is taken off a commented header."""
        first = True
        for number in itertools.count(1):
            line = read_line(self.path, stream, number)
            if not line:
                return
            if number <= self._layout.skip_rows or not line.strip():
                continue
            comment = self._layout.comment
            if comment is not None and line.lstrip().startswith(comment):
                if not (first and self._layout.header):
                    continue
                line = line.lstrip().removeprefix(comment)
            first = False
            yield number, line.rstrip("\r\n")
            if not line.endswith("\n") and _UNFINISHED not in self.notes:
                self.notes.append(_UNFINISHED)

    def _fields(self, line: str) -> list[str]:
        if self._separator is None:
            return line.split()
        return next(csv.reader([line], delimiter=self._separator))

    def _numbers(self, block: Sequence[Line], indices: Sequence[int]) -> NDArray[np.float64]:
        """Parses lines fast; looks at them one by one only to say what is wrong."""
        texts = [text for _, text in block]
        if not indices:
            self._find_fault(block, indices)
            return np.empty((len(block), 0))
        self._check_widths(block)
        try:
            return np.loadtxt(
                texts, delimiter=self._separator, usecols=indices, ndmin=2, comments=None, quotechar='"'
            )
        except ValueError as error:
            self._find_fault(block, indices)
            raise BadInput(f"{self.path}:{block[0][0]}: no table of numbers: {error}") from error

    def _check_widths(self, block: Sequence[Line]) -> None:
        width = len(self.names)
        for number, text in block:
            count = len(text.split()) if self._separator is None else text.count(self._separator) + 1
            if count != width and ('"' not in text or len(self._fields(text)) != width):
                raise BadInput(self._ragged(number, text, count))

    def _ragged(self, number: int, text: str, count: int) -> str:
        advice = "is the line cut off, or the separator another one?"
        if count == 1 and len(self.names) > 1 and not text.strip('"').replace(".", "").strip():
            advice = "remove the line"
        return (
            f"{self.path}:{number}: {count} values in a table of {len(self.names)} columns: {advice}"
            " (valid: whole lines; remove a last line that the recorder did not finish)"
        )

    def _find_fault(self, block: Sequence[Line], indices: Sequence[int]) -> None:
        """Raises at the first value that is no number."""
        for number, text in block:
            fields = self._fields(text)
            for index in indices:
                value = fields[index].strip()
                if not _is_number(value):
                    what = f"is {value[:40]!r}" if value else "is empty"
                    raise BadInput(
                        f"{self.path}:{number}: column '{self.names[index]}' {what}, not a number{_advice(value)}"
                    )


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _advice(value: str) -> str:
    if not value:
        return " (valid: a value in every line; leave out a column that was not measured)"
    if value.count(",") == 1 and _is_number(value.replace(",", ".")):
        return " (valid: a decimal point)"
    if value.isidentifier():
        return " (a second header? split the file there, or say 'header: true')"
    return " (valid: decimal numbers)"


@contextmanager
def open_text(path: Path) -> Iterator[TextIO]:
    """Opens a text file.

    Raises:
        BadInput: It is missing, no regular file, or cannot be read, also while it is open.
    """
    try:
        with open_input(path) as raw, io.TextIOWrapper(raw, encoding="utf-8-sig", newline=None) as stream:
            yield stream
    except UnicodeDecodeError as error:
        raise BadInput(f"{path}: no text file: {error} (valid: a table as UTF-8 text)") from error
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {error.strerror}") from error


def read_line(path: Path, stream: TextIO, number: int) -> str:
    """Returns the next line, or nothing at the end.

    Raises:
        BadInput: The line has no end, or holds binary data.
    """
    line = stream.readline(LONGEST_LINE)
    if len(line) == LONGEST_LINE or "\0" in line:
        raise BadInput(f"{path}:{number}: binary data, or a line without end (valid: a table as text)")
    return line
