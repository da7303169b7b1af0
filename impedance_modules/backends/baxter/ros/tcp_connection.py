# SPDX-License-Identifier: BSD-3-Clause
"""How TCPROS cuts a stream into pieces: a length before everything, ``key=value`` fields in the greeting."""

from __future__ import annotations

import http.client
import socket
import struct
import xmlrpc.client
from collections.abc import Mapping
from typing import Any

from impedance_modules.errors import ImpedanceError

LENGTH = struct.Struct("<I")

LONGEST_GREETING = 1 << 20
"""A greeting above this many bytes is not one."""

LONGEST_MESSAGE = 1 << 24
"""No message here is above 16 MB; a length beyond that is not one."""


class GreetingError(ImpedanceError):
    """The other side of a connection greeted wrongly, refused, or hung up."""


def pack_greeting(fields: Mapping[str, str]) -> bytes:
    """Lays out the fields that open a connection."""
    parts = []
    for key, value in fields.items():
        field = f"{key}={value}".encode()
        parts.append(LENGTH.pack(len(field)) + field)
    body = b"".join(parts)
    return LENGTH.pack(len(body)) + body


def read_greeting(connection: socket.socket) -> dict[str, str]:
    """Reads the fields that open a connection.

    Raises:
        GreetingError: They are none, or the other side says ``error``.
        OSError: The connection fails or its time-out passes.
    """
    (length,) = LENGTH.unpack(_exactly(connection, LENGTH.size))
    if length > LONGEST_GREETING:
        raise GreetingError(f"a greeting of {length} bytes is not TCPROS")
    body = _exactly(connection, length)
    fields: dict[str, str] = {}
    at = 0
    while at < length:
        if at + LENGTH.size > length:
            raise GreetingError("the greeting breaks off")
        (size,) = LENGTH.unpack_from(body, at)
        key, equals, value = body[at + 4 : at + 4 + size].decode("utf-8", "replace").partition("=")
        if not equals or at + 4 + size > length:
            raise GreetingError("the greeting is not TCPROS")
        fields[key] = value
        at += 4 + size
    if "error" in fields:
        raise GreetingError(fields["error"])
    return fields


def cut_frames(buffer: bytearray) -> bytes | None:
    """Takes all whole messages off the front of a buffer and returns the newest one.

    Raises:
        GreetingError: A length that no message has; the stream is out of step.
    """
    newest, at = None, 0
    while len(buffer) - at >= LENGTH.size:
        (size,) = LENGTH.unpack_from(buffer, at)
        if size > LONGEST_MESSAGE:
            raise GreetingError(f"a message of {size} bytes is not one")
        if len(buffer) - at - LENGTH.size < size:
            break
        newest = (at + LENGTH.size, at + LENGTH.size + size)
        at += LENGTH.size + size
    data = None if newest is None else bytes(buffer[newest[0] : newest[1]])
    del buffer[:at]
    return data


def _exactly(connection: socket.socket, count: int) -> bytes:
    parts = bytearray()
    while len(parts) < count:
        more = connection.recv(count - len(parts))
        if not more:
            raise GreetingError("the other side hung up")
        parts += more
    return bytes(parts)


class TimedTransport(xmlrpc.client.Transport):
    """XML-RPC that gives up after a while."""

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self._seconds = seconds

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        """Connects with a deadline."""
        connection = super().make_connection(host)
        connection.timeout = self._seconds
        return connection


def remote(uri: str, seconds: float) -> xmlrpc.client.ServerProxy:
    """Returns a proxy of an XML-RPC server whose every call takes at most ``seconds`` per socket operation."""
    return xmlrpc.client.ServerProxy(uri, transport=TimedTransport(seconds), allow_none=True)
