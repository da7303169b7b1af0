# SPDX-License-Identifier: BSD-3-Clause
"""Opens ROS recordings of every kind (ROS 1 bag, sqlite, MCAP) and finds the messages with joint states."""

from __future__ import annotations

import re
import struct
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import apsw
import numpy as np
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat, Nodetype
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import ReaderError as ReaderError1
from rosbags.rosbag2 import Reader as Reader2
from rosbags.rosbag2 import ReaderError as ReaderError2
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore

from impedance_modules.episode.imports.message_types import LONGEST_DEFINITION, are_plain, is_type_name
from impedance_modules.episode.imports.packed_chunks import bound_chunks
from impedance_modules.errors import BadInput
from impedance_modules.input_files import check_file

if sys.version_info >= (3, 14):
    from compression.zstd import ZstdError
else:
    from backports.zstd import ZstdError

NAME_FIELDS = ("name", "names", "joint_names")
"""Fields in which messages list their joints."""

_NAME_LIST = re.compile(r"(string\[\]|sequence<string>)\s+(name|names|joint_names)\b")
_DAMAGE = (
    *(ReaderError1, ReaderError2, SerdeError, TypesysError, ZstdError, apsw.Error, struct.error),
    *(OSError, EOFError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError),
    *(AssertionError, RuntimeError, MemoryError, SyntaxError),
)
"""Errors that reading damaged bags raised in tests."""


@dataclass(frozen=True)
class JointTopic:
    """A topic whose messages list joints by name, with numbers for each.

    Attributes:
        topic, msgtype: As ROS calls them.
        name_field: Field with the joints' names.
        fields: Fields with one number for each name.
        stamped: The type has a header.
        messages: How many there are.
    """

    topic: str
    msgtype: str
    name_field: str
    fields: tuple[str, ...]
    stamped: bool
    messages: int


@dataclass(frozen=True, eq=False)
class JointMessage:
    """One message: who, when received, when stamped [ns], joints, and the message itself."""

    topic: str
    received: int
    stamp: int | None
    names: tuple[str, ...]
    fields: Any

    def numbers(self, field: str) -> np.ndarray[Any, np.dtype[Any]]:
        """Returns the numbers of one field."""
        return np.asarray(getattr(self.fields, field))


class BagFile:
    """A recording that is open.

    Attributes:
        path: As the user wrote it.
        topics: Topics about joints, by name.
        others: Types of all other topics.
    """

    def __init__(self, path: Path, reader: Reader1 | Reader2) -> None:
        """Looks through the connections of an open reader."""
        self.path = path
        self._reader = reader
        self._types = get_typestore(Stores.EMPTY)
        self._ros1 = isinstance(reader, Reader1)
        self._connections = list(reader.connections)
        self.topics: dict[str, JointTopic] = {}
        for connection in self._connections:
            found = self._joint_topic(connection)
            if found is not None:
                self.topics[found.topic] = found
        self.others = tuple(sorted({c.msgtype for c in self._connections if c.topic not in self.topics}))

    def messages(self, topics: Collection[str]) -> Iterator[JointMessage]:
        """Yields the messages of some topics in the order in which they were received.

        Raises:
            BadInput: The bag is damaged.
        """
        chosen = [connection for connection in self._connections if connection.topic in topics]
        with reporting_damage(self.path):
            for connection, received, raw in self._reader.messages(connections=chosen):
                if self._ros1:
                    message: Any = self._types.deserialize_ros1(raw, connection.msgtype)
                else:
                    message = self._types.deserialize_cdr(raw, connection.msgtype)
                topic = self.topics[connection.topic]
                stamp = message.header.stamp if topic.stamped else None
                yield JointMessage(
                    topic=connection.topic,
                    received=received,
                    stamp=None if stamp is None else stamp.sec * 1_000_000_000 + stamp.nanosec,
                    names=tuple(getattr(message, topic.name_field)),
                    fields=message,
                )

    def _joint_topic(self, connection: Connection) -> JointTopic | None:
        """Returns the joint states that a connection holds, or None if it holds none."""
        if not self._learn(connection):
            return None
        fields = dict(self._types.fielddefs[connection.msgtype][1])
        name = next((field for field in NAME_FIELDS if _is_list(fields.get(field), "string")), None)
        numbers = tuple(
            f for f, kind in fields.items() if _is_list(kind, "float64") or _is_list(kind, "float32")
        )
        if name is None or not numbers:
            return None
        known = self.topics.get(connection.topic)
        count = connection.msgcount + (known.messages if known else 0)
        return JointTopic(connection.topic, connection.msgtype, name, numbers, "header" in fields, count)

    def _learn(self, connection: Connection) -> bool:
        """Makes a message type known; returns whether it may hold joint states."""
        definition = connection.msgdef
        extension = connection.ext
        if isinstance(extension, ConnectionExtRosbag2) and extension.serialization_format != "cdr":
            return False
        if not is_type_name(connection.msgtype) or len(definition.data) > LONGEST_DEFINITION:
            return False
        if connection.msgtype in self._types.fielddefs:
            return True
        if definition.format == MessageDefinitionFormat.NONE:
            latest = get_typestore(Stores.LATEST)  # early bags of ROS 2 rely on the reader's definitions
            if connection.msgtype not in latest.fielddefs:
                return False
            self._types = latest if not self._types.fielddefs else _merged(latest, self._types)
            return True
        return bool(_NAME_LIST.search(definition.data)) and self._register(connection)

    def _register(self, connection: Connection) -> bool:
        """Reads a message definition; an unreadable type must not prevent the reading of other topics."""
        definition = connection.msgdef
        try:
            if definition.format == MessageDefinitionFormat.MSG:
                types = get_types_from_msg(definition.data, connection.msgtype)
            else:
                types = get_types_from_idl(definition.data)
            if not are_plain(types):
                return False
            self._types.register(types)
        except (TypesysError, SyntaxError, RecursionError):
            return False
        return connection.msgtype in self._types.fielddefs


@contextmanager
def open_bag(path: Path) -> Iterator[BagFile]:
    """Opens a recording for as long as the block runs.

    Args:
        path: A ``.bag``, ``.mcap`` or ``.db3`` file, or the directory of a ROS 2 recording.

    Raises:
        BadInput: Damaged, cut off, not indexed, or no recording.
    """
    for file in sorted(path.iterdir()) if path.is_dir() else (path,):
        if not file.is_dir():
            check_file(file)
    bound_chunks()
    with reporting_damage(path):
        reader = Reader1(path) if path.is_file() and path.suffix not in {".mcap", ".db3"} else Reader2(path)
        reader.open()
    try:
        with reporting_damage(path):
            bag = BagFile(path, reader)
        yield bag
    finally:
        reader.close()


@contextmanager
def reporting_damage(path: Path) -> Iterator[None]:
    """Turns every error that a damaged bag causes into one sentence."""
    try:
        yield
    except _DAMAGE as error:
        said = str(error) or type(error).__name__
        raise BadInput(
            f"{path}: the recording is damaged, cut off or not indexed: {said}"
            " (valid: a whole bag; 'rosbag reindex' or 'ros2 bag reindex' mends an unfinished one)"
        ) from error


def _is_list(kind: Any, of: str) -> bool:
    """Whether a field is an array or sequence of a basic type."""
    if kind is None or kind[0] not in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        return False
    inner = kind[1][0]
    return bool(inner[0] == Nodetype.BASE and inner[1][0] == of)


def _merged(first: Any, second: Any) -> Any:
    """One store that knows the types of both; the second's definitions win."""
    first.fielddefs.update(second.fielddefs)
    first.types.update(second.types)
    return first
