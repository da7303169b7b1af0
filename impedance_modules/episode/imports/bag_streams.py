# SPDX-License-Identifier: BSD-3-Clause
"""The streams of a bag: messages of one topic that list the same joints, spooled to disk."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_modules.episode.imports.bag_file import JointMessage
from impedance_modules.episode.imports.spool import Spool
from impedance_modules.errors import BadInput

WIDEST_HOLE = 10.0
"""Typical steps of a stream without a message, from which on its values are unknown in between."""

STEP_SAMPLE = 10_000
"""Messages from which a stream's typical step is taken."""

Array = NDArray[np.float64]
ColumnPlace = tuple[str, str, str]
"""Topic, field, joint."""


class Stream:
    """Messages of one topic that list the same joints.

    Attributes:
        topic: Where they came from.
        columns: Column name -> place in a row; place 0 is the time [s], place 1 the message's number.
    """

    def __init__(self, topic: str, columns: Mapping[str, ColumnPlace], spool: Spool) -> None:
        """Starts empty."""
        self.topic = topic
        self.columns = {name: index for index, name in enumerate(columns, start=2)}
        self._fields = [(field, joint) for _, field, joint in columns.values()]
        self._spool = spool
        self._array: Array | None = None

    @property
    def rows(self) -> int:
        """Messages so far."""
        return self._spool.rows

    def take(self, time: float, number: int, message: JointMessage, place: str) -> None:
        """Adds one message.

        Raises:
            BadInput: A field without a number for each joint.
        """
        index = {name: position for position, name in enumerate(message.names)}
        arrays = {field: message.numbers(field) for field in {field for field, _ in self._fields}}
        for field, values in arrays.items():
            if len(values) != len(message.names):
                raise BadInput(
                    f"{place}: '{field}' of {message.topic} has {len(values)} values for {len(message.names)} joints"
                    f" (valid: one for each; if '{field}' was not measured, leave it out of the map)"
                )
        self._spool.append(
            [time, float(number), *(arrays[field][index[joint]] for field, joint in self._fields)]
        )

    def array(self) -> Array:
        """Returns all rows, on disk: time, number, columns."""
        if self._array is None:
            self._array = self._spool.array()
        return self._array

    def covers(self, time: Array) -> NDArray[np.bool_]:
        """Returns at which times the stream has a message close before and after."""
        own = self.array()[:, 0]
        after = np.searchsorted(own, time, side="left").clip(1, len(own) - 1)
        # The typical step, from a part that is long enough: the whole would have to be read for each chunk.
        step = float(np.median(np.diff(own[:STEP_SAMPLE])))
        close = own[after] - own[after - 1] <= WIDEST_HOLE * step
        known: NDArray[np.bool_] = close | (own[after] == time) | (own[after - 1] == time)
        return known

    def at(self, time: Array, held: Collection[str]) -> dict[str, Array]:
        """Returns the columns at other times: those ``held`` as last said, the others interpolated."""
        rows = self.array()
        own = rows[:, 0]
        first = max(int(np.searchsorted(own, time[0], side="right")) - 1, 0)
        last = int(np.searchsorted(own, time[-1], side="left")) + 1
        part = np.array(rows[first:last])
        before = (np.searchsorted(part[:, 0], time, side="right") - 1).clip(0)
        return {
            name: part[before, index] if name in held else np.interp(time, part[:, 0], part[:, index])
            for name, index in self.columns.items()
        }


class StreamSet:
    """All streams of one bag that hold wanted columns."""

    def __init__(self, path: Path, columns: Mapping[str, ColumnPlace], clock: str, folder: Path) -> None:
        """Starts empty.

        Args:
            path: Of the bag, for messages.
            columns: Wanted column -> (topic, field, joint).
            clock: ``header`` or ``received``.
            folder: For the rows, on disk.
        """
        self.start: int | None = None
        self._path = path
        self._columns = columns
        self._clock = clock
        self._folder = folder
        self._streams: dict[tuple[str, frozenset[str]], Stream | None] = {}

    def take(self, message: JointMessage, number: int) -> None:
        """Sorts one message into its stream.

        Raises:
            BadInput: It has no stamp, or not a number for each joint.
        """
        key = (message.topic, frozenset(message.names))
        if key not in self._streams:
            self._streams[key] = self._new_stream(*key)
        stream = self._streams[key]
        if stream is None:
            return
        moment = self._moment(message, number)
        if self.start is None:
            self.start = moment
        stream.take((moment - self.start) * 1e-9, number, message, f"{self._path}:{number}")

    def sorted_by(self, leading: Sequence[str]) -> tuple[Stream, tuple[Stream, ...]]:
        """Returns the stream that gives the rows, and the others.

        Each column is taken from one stream: of several that hold it, from the one with more of the wanted
        columns, then more messages.

        Args:
            leading: Columns of the measured positions.

        Raises:
            BadInput: A wanted column is in no stream, or a stream's time does not run forwards.
        """
        streams = [stream for stream in self._streams.values() if stream is not None and stream.rows]
        streams.sort(key=lambda stream: (-len(stream.columns), -stream.rows))
        taken: set[str] = set()
        for stream in streams:
            stream.columns = {name: index for name, index in stream.columns.items() if name not in taken}
            taken |= set(stream.columns)
        missing = [name for name in self._columns if name not in taken]
        if missing:
            raise BadInput(f"{self._path}: no message holds '{missing[0]}'")
        streams = [stream for stream in streams if stream.columns]
        base = max(streams, key=lambda stream: (len(set(leading) & set(stream.columns)), stream.rows))
        others = tuple(stream for stream in streams if stream is not base)
        for stream in others:
            self._check_order(stream)
        return base, others

    def _new_stream(self, topic: str, joints: frozenset[str]) -> Stream | None:
        columns = {
            name: place for name, place in self._columns.items() if place[0] == topic and place[2] in joints
        }
        if not columns:
            return None
        spool = Spool(self._folder / f"stream-{len(self._streams)}", len(columns) + 2)
        return Stream(topic, columns, spool)

    def _moment(self, message: JointMessage, number: int) -> int:
        if self._clock == "received":
            return message.received
        if not message.stamp:
            raise BadInput(
                f"{self._path}:{number}: a message of {message.topic} without a stamp in its header"
                " (valid: say 'time: {clock: received}' for this table in the map)"
            )
        return message.stamp

    def _check_order(self, stream: Stream) -> None:
        rows = stream.array()
        if len(rows) < 2:
            raise BadInput(f"{self._path}: a single message of {stream.topic} (valid: two or more)")
        backwards = np.diff(rows[:, 0]) <= 0.0
        if backwards.any():
            number = int(rows[int(np.argmax(backwards)) + 1, 1])
            raise BadInput(
                f"{self._path}:{number}: the stamps of {stream.topic} do not run forwards"
                " (valid: say 'time: {clock: received}' for this table in the map)"
            )
