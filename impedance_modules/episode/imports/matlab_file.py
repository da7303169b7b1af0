# SPDX-License-Identifier: BSD-3-Clause
"""MATLAB's .mat files of the versions 4 and 5 (``-v4``, ``-v6``, ``-v7``): real arrays and structs of them.

A reader of our own: what every length in a file says is compared with what the file holds before memory is taken, and
nothing outside the file is ever read, which cannot be said of readers written for honest files. Text, cells, sparse
and complex arrays, objects and arrays of structs are left out.

Source: MathWorks, MAT-File Format.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Value = NDArray[Any] | dict[str, Any]
"""An array, squeezed, or a struct's fields."""

LARGEST_CONTENT = 4_000_000_000
"""Bytes of a compressed file once it is unpacked."""

DEEPEST = 5
"""Structs within structs that are read."""

_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_MATRIX, _COMPRESSED = 14, 15
_STRUCT, _NUMERIC_CLASSES, _COMPLEX = 2, range(6, 16), 0x0800
_NUMBERS_4 = ("f8", "f4", "i4", "i2", "u2", "u1")
_HEADER, _TAG, _SMALL = 128, 8, 4
_MOST_DIMENSIONS = 32


class NewerVersionError(ValueError):
    """A file of another version, said in the message."""


def read_variables(raw: bytes) -> dict[str, Value]:
    """Reads all variables.

    Raises:
        NewerVersionError: A file of version 7.3.
        ValueError: No such file, or a damaged one.
        zlib.error: Damaged where it is compressed.
    """
    if len(raw) >= 4 and 0 in raw[:4]:
        return dict(_version_4(raw))
    if len(raw) < _HEADER or raw[126:128] not in (b"IM", b"MI"):
        raise ValueError("no MATLAB file, or cut off")
    order = "<" if raw[126:128] == b"IM" else ">"
    if int.from_bytes(raw[124:126], "little" if order == "<" else "big") != 0x0100:
        raise NewerVersionError("a MATLAB 7.3 file")
    found: dict[str, Value] = {}
    left = LARGEST_CONTENT
    for element in _Elements(memoryview(raw)[_HEADER:], order).each():
        kind, data = element
        if kind == _COMPRESSED:
            unpacked = _unpacked(data, left)
            left -= len(unpacked)
            kind, data = _next(_Elements(memoryview(unpacked), order).each())
        if kind == _MATRIX:
            name, value = _matrix(data, order, 0)
            if value is not None:
                found[name] = value
    return found


@dataclass(frozen=True)
class _Elements:
    """Data elements one after the other: a tag with kind and length, then the data, padded to eight bytes."""

    view: memoryview
    order: str

    def each(self) -> Iterator[tuple[int, memoryview]]:
        at = 0
        while at + _TAG <= len(self.view):
            kind, size = self._whole(at), self._whole(at + 4)
            first = at + _TAG
            if kind >> 16:  # a small element: its length stands in the tag's upper half, its data in the tag
                kind, size, first = kind & 0xFFFF, kind >> 16, at + 4
                if size > _SMALL:
                    raise ValueError("an element is longer than its tag says")
                at += _TAG
            else:
                at = first + size + (0 if kind == _COMPRESSED else -size % 8)
            if first + size > len(self.view):
                raise ValueError("cut off")
            yield kind, self.view[first : first + size]

    def _whole(self, at: int) -> int:
        return int.from_bytes(self.view[at : at + 4], "little" if self.order == "<" else "big")


def _matrix(data: memoryview, order: str, depth: int) -> tuple[str, Value | None]:
    """Reads one array or struct; None for what is left out."""
    parts = _Elements(data, order).each()
    flags, shape_, name_ = (_next(parts) for _ in range(3))
    flag = _array(*flags, order)
    shape = tuple(int(number) for number in _array(*shape_, order))
    if not flag.size or not 2 <= len(shape) <= _MOST_DIMENSIONS or min(shape) < 0:
        raise ValueError("an array without a shape")
    name, kind = bytes(name_[1]).decode("ascii", "replace"), int(flag[0]) & 0xFF
    if kind == _STRUCT and shape == (1, 1) and depth < DEEPEST:
        return name, _struct(parts, order, depth)
    if kind not in _NUMERIC_CLASSES or int(flag[0]) & _COMPLEX:
        return name, None
    values = _array(*_next(parts), order)
    if values.size != math.prod(shape):
        raise ValueError(f"'{name}' has {values.size} numbers for a shape of {shape}")
    return name, np.squeeze(values.reshape(shape, order="F"))


def _struct(parts: Iterator[tuple[int, memoryview]], order: str, depth: int) -> dict[str, Value]:
    (length,) = _array(*_next(parts), order).tolist()
    text = bytes(_next(parts)[1])
    if not isinstance(length, int) or not 0 < length <= 256 or len(text) % length:
        raise ValueError("a struct whose names have no length")
    names = [
        text[at : at + length].split(b"\0")[0].decode("ascii", "replace")
        for at in range(0, len(text), length)
    ]
    found: dict[str, Value] = {}
    for name in names:
        kind, data = _next(parts)
        if kind != _MATRIX:
            raise ValueError(f"the field '{name}' is no array")
        value = _matrix(data, order, depth + 1)[1] if len(data) else None
        if value is not None:
            found[name] = value
    return found


def _next(parts: Iterator[tuple[int, memoryview]]) -> tuple[int, memoryview]:
    found = next(parts, None)
    if found is None:
        raise ValueError("cut off")
    return found


def _array(kind: int, data: memoryview, order: str) -> NDArray[Any]:
    if kind not in _NUMBERS:
        raise ValueError(f"numbers of an unknown kind, {kind}")
    stored = np.dtype(order + _NUMBERS[kind])
    if len(data) % stored.itemsize:
        raise ValueError("cut off within a number")
    return np.frombuffer(data, dtype=stored).astype(stored.newbyteorder("="))


def _unpacked(data: memoryview, most: int) -> bytes:
    unpacking = zlib.decompressobj()
    unpacked = unpacking.decompress(data, most)
    if unpacking.unconsumed_tail:
        raise ValueError(f"unpacked, it has more than {LARGEST_CONTENT} bytes")
    if not unpacking.eof:
        raise ValueError("cut off")
    if len(unpacked) < _TAG:
        raise ValueError("an empty element")
    return unpacked


def _version_4(raw: bytes) -> Iterator[tuple[str, Value]]:
    at = 0
    while at < len(raw):
        head = np.frombuffer(raw[at : at + 20], dtype="<i4") if at + 20 <= len(raw) else None
        if head is None:
            raise ValueError("cut off")
        order = "<" if 0 <= head[0] < 1000 else ">"
        kind, rows, columns, imaginary, length = (int(number) for number in head.view(f"{order}i4"))
        number, stored = kind // 10 % 10, kind % 10
        if (
            kind // 1000 != (order == ">")
            or number >= len(_NUMBERS_4)
            or min(rows, columns) < 0
            or length < 1
        ):
            raise ValueError("no MATLAB file")
        numbers = np.dtype(order + _NUMBERS_4[number])
        first, size = at + 20 + length, rows * columns * numbers.itemsize
        at = first + size * (2 if imaginary else 1)
        if at > len(raw):
            raise ValueError("cut off")
        if stored == 0 and not imaginary:
            name = raw[first - length : first].split(b"\0")[0].decode("ascii", "replace")
            values = np.frombuffer(raw[first : first + size], dtype=numbers).astype(numbers.newbyteorder("="))
            yield name, np.squeeze(values.reshape((rows, columns), order="F"))
