# SPDX-License-Identifier: BSD-3-Clause
"""Encodes and decodes messages as ROS 1 does: little-endian, every length a uint32 in front."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import fields
from functools import cache, lru_cache
from typing import Any, TypeVar, cast

from impedance_modules.backends.baxter.ros.message_definitions import MessageField, checksum, definition
from impedance_modules.backends.baxter.ros.messages import MESSAGE_TYPES, Message
from impedance_modules.errors import ImpedanceError

M = TypeVar("M", bound=Message)

Encoder = Callable[[Any, list[bytes]], None]
"""Appends a value's bytes."""
Decoder = Callable[[bytes, int], tuple[Any, int]]
"""Reads a value at an offset; returns it and the offset behind it."""

LAYOUT = {
    "bool": "?",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "float32": "f",
    "float64": "d",
}
"""ROS primitive -> letter of Python's struct module."""

NANOSECONDS = 1_000_000_000
COUNT = struct.Struct("<I")
TIME = struct.Struct("<II")


class MessageError(ImpedanceError):
    """Bytes that are not the message they claim to be, or values that do not fit their fields."""


def encode(message: Message) -> bytes:
    """Encodes a message as ROS sends it.

    Raises:
        MessageError: A value does not fit its field, e.g. 70000 in a uint16.
    """
    parts: list[bytes] = []
    try:
        _encoder(message.ros_type)(message, parts)
    except (struct.error, TypeError, ValueError, AttributeError) as error:
        raise MessageError(f"{message.ros_type}: a value does not fit its field: {error}") from error
    return b"".join(parts)


def decode(message_type: type[M], data: bytes) -> M:
    """Reads a message from exactly these bytes.

    Raises:
        MessageError: They are too short, too long, or no such message.
    """
    name = message_type.ros_type
    try:
        message, end = _decoder(name)(data, 0)
    except (struct.error, UnicodeDecodeError, MemoryError, OverflowError) as error:
        raise MessageError(f"{name}: {len(data)} bytes cannot be read as it: {error}") from error
    if end != len(data):
        raise MessageError(f"{name}: {len(data)} bytes where the message ends after {end}")
    return cast(M, message)


def checksum_of(message_type: type[Message]) -> str:
    """Returns the MD5 of a message type."""
    return checksum(message_type.ros_type)


@cache
def _encoder(kind: str) -> Encoder:
    if kind in LAYOUT:
        pack = struct.Struct("<" + LAYOUT[kind]).pack
        return lambda value, out: out.append(pack(value))
    if kind == "string":
        return _write_string
    if kind == "time":
        return lambda value, out: out.append(TIME.pack(*divmod(value, NANOSECONDS)))
    names = [own.name for own in fields(cast(Any, MESSAGE_TYPES[kind]))]
    parts = [
        (name, _field_encoder(field)) for name, field in zip(names, definition(kind).fields, strict=True)
    ]

    def write(message: Any, out: list[bytes]) -> None:
        for name, part in parts:
            part(getattr(message, name), out)

    return write


def _field_encoder(field: MessageField) -> Encoder:
    if not field.repeated:
        return _encoder(field.kind)
    if field.kind in LAYOUT:
        letter = LAYOUT[field.kind]
        return lambda values, out: out.append(struct.pack(f"<I{len(values)}{letter}", len(values), *values))
    if field.kind == "string":
        # Lists of names are the same in every message.
        return lambda values, out: out.append(_names_bytes(tuple(values)))
    one = _encoder(field.kind)

    def write(values: Any, out: list[bytes]) -> None:
        out.append(COUNT.pack(len(values)))
        for value in values:
            one(value, out)

    return write


@lru_cache(maxsize=256)
def _names_bytes(names: tuple[str, ...]) -> bytes:
    parts = [COUNT.pack(len(names))]
    for name in names:
        _write_string(name, parts)
    return b"".join(parts)


def _write_string(value: str, out: list[bytes]) -> None:
    data = value.encode()
    out.append(COUNT.pack(len(data)))
    out.append(data)


@cache
def _decoder(kind: str) -> Decoder:
    if kind in LAYOUT:
        layout = struct.Struct("<" + LAYOUT[kind])
        return lambda data, at: (layout.unpack_from(data, at)[0], at + layout.size)
    if kind == "string":
        return _read_string
    if kind == "time":
        return _read_time
    make: Callable[..., Message] = MESSAGE_TYPES[kind]
    parts = [_field_decoder(field) for field in definition(kind).fields]

    def read(data: bytes, at: int) -> tuple[Any, int]:
        values = []
        for part in parts:
            value, at = part(data, at)
            values.append(value)
        return make(*values), at

    return read


def _field_decoder(field: MessageField) -> Decoder:
    if not field.repeated:
        return _decoder(field.kind)
    if field.kind in LAYOUT:
        letter, size = LAYOUT[field.kind], struct.calcsize("<" + LAYOUT[field.kind])

        def read_numbers(data: bytes, at: int) -> tuple[Any, int]:
            (count,) = COUNT.unpack_from(data, at)
            _check_room(data, at + 4, count * size)
            return struct.unpack_from(f"<{count}{letter}", data, at + 4), at + 4 + count * size

        return read_numbers
    if field.kind == "string":
        return _NamesReader().read
    one = _decoder(field.kind)

    def read_values(data: bytes, at: int) -> tuple[Any, int]:
        (count,) = COUNT.unpack_from(data, at)
        _check_room(data, at + 4, count)
        values, at = [], at + 4
        for _ in range(count):
            value, at = one(data, at)
            values.append(value)
        return tuple(values), at

    return read_values


class _NamesReader:
    """Reads lists of names, which seldom differ from one of the last: compares bytes instead of decoding them."""

    def __init__(self) -> None:
        self._known: tuple[tuple[bytes, tuple[str, ...]], ...] = ()

    def read(self, data: bytes, at: int) -> tuple[tuple[str, ...], int]:
        """Returns the names and the offset behind them."""
        for raw, names in self._known:
            if data.startswith(raw, at):
                return names, at + len(raw)
        (count,) = COUNT.unpack_from(data, at)
        _check_room(data, at + 4, count)
        found, end = [], at + 4
        for _ in range(count):
            name, end = _read_string(data, end)
            found.append(name)
        if count:
            self._known = ((data[at:end], tuple(found)), *self._known[:3])
        return tuple(found), end


def _read_string(data: bytes, at: int) -> tuple[str, int]:
    (count,) = COUNT.unpack_from(data, at)
    _check_room(data, at + 4, count)
    end = at + 4 + count
    return data[at + 4 : end].decode(), end


def _read_time(data: bytes, at: int) -> tuple[int, int]:
    seconds, nanoseconds = TIME.unpack_from(data, at)
    return seconds * NANOSECONDS + nanoseconds, at + TIME.size


def _check_room(data: bytes, at: int, needed: int) -> None:
    """Refuses a length that the bytes cannot hold, before memory is allocated for it."""
    if at + needed > len(data):
        raise struct.error(f"{needed} bytes wanted at {at}, {len(data) - at} there")
