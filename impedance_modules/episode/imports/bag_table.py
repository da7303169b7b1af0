# SPDX-License-Identifier: BSD-3-Clause
"""A ROS recording as one table: joints matched by name, whoever published them, on one clock.

The messages of one topic that list the same joints are a stream, kept on disk. The stream with most positions gives
the rows; the others are brought to its times: what was measured by interpolation, what was commanded by holding the
last command. Where a stream has a gap, nothing is interpolated: its rows are left out.
"""

from __future__ import annotations

import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.episode.columns import TIME
from impedance_modules.episode.imports.bag_file import BagFile, JointMessage, open_bag
from impedance_modules.episode.imports.import_map import COMMANDS, TableMap
from impedance_modules.episode.imports.table import CHUNK_ROWS, Chunk, find_column, refuse_nonfinite
from impedance_modules.errors import BadInput

PEEK = 400
"""Messages of each topic that are looked at to learn which joints it lists."""

WIDEST_GAP = 10.0
"""Typical steps without a message, above which a stream's values in between count as unknown."""

STEP_SAMPLE = 10_000
"""Messages from which a stream's typical step is taken."""

ColumnPlace = tuple[str, str, str]
"""Topic, field, joint."""

_BUFFERED = 4096
"""Rows that wait in memory."""


class BagTable:
    """One recording; its columns are called ``TOPIC.FIELD.JOINT``, and ``time`` [s] from the first row.

    Attributes:
        path, names, scalars, row_word, notes: See `LogTable`.
        start: When the first row was measured [ns since the epoch of the robot's clock]; known once read.
    """

    def __init__(self, path: Path, table: TableMap, scratch: Path) -> None:
        """Looks at the first messages.

        Args:
            path: Of the recording.
            table: What is wanted of it.
            scratch: Directory for rows that are being merged.

        Raises:
            BadInput: Damaged, or without messages about joints.
        """
        self.path = path
        self.scalars: Mapping[str, float] = {}
        self.row_word = "message"
        self.notes: list[str] = []
        self.start: int | None = None
        self._scratch = scratch
        self._clock = "header" if table.time is None or table.time.clock is None else table.time.clock
        with open_bag(path) as bag:
            self._columns = column_places(bag)
        self.names = (TIME, *self._columns)
        commands = [q for q in table.quantities if q.kind in COMMANDS]
        self._held = {find_column(self, name) for q in commands for name in q.columns.values()}
        self._leading = [
            find_column(self, name)
            for q in table.quantities
            if q.kind == "position"
            for name in q.columns.values()
        ]

    def chunks(self, wanted: Sequence[str]) -> Iterator[Chunk]:
        """Yields the wanted columns; see `LogTable`."""
        with tempfile.TemporaryDirectory(dir=self._scratch) as folder:
            columns = {name: self._columns[name] for name in wanted if name != TIME}
            streams = StreamSet(self.path, columns, self._clock, Path(folder))
            topics = {topic for topic, _, _ in columns.values()}
            with open_bag(self.path) as bag:
                for number, message in enumerate(bag.messages(topics), start=1):
                    streams.take(message, number)
            self.start = streams.start
            base, others = streams.sorted_by(self._leading)
            if others:
                self.notes.append(_merge_note(base, others))
            yield from self._rows(base, others)

    def _rows(self, base: Stream, others: Sequence[Stream]) -> Iterator[Chunk]:
        own = base.array()
        begin = max([own[0, 0], *(stream.array()[0, 0] for stream in others)])
        end = min([own[-1, 0], *(stream.array()[-1, 0] for stream in others)])
        dropped = 0
        for first in range(0, len(own), CHUNK_ROWS):
            block = np.array(own[first : first + CHUNK_ROWS])
            keep = (block[:, 0] >= begin) & (block[:, 0] <= end)
            for stream in others:
                keep &= stream.covers(block[:, 0])
            dropped += int(np.count_nonzero(~keep))
            if keep.any():
                yield self._chunk(base, others, block[keep])
        if dropped:
            self.notes.append(f"{dropped} of {len(own)} messages left out: another stream has no value there")

    def _chunk(self, base: Stream, others: Sequence[Stream], rows: NDArray[np.float64]) -> Chunk:
        time = rows[:, 0]
        columns = {TIME: time}
        columns.update({name: rows[:, index] for name, index in base.columns.items()})
        for stream in others:
            columns.update(stream.at(time, self._held))
        places = rows[:, 1].astype(np.int64)
        return refuse_nonfinite(self.path, self.row_word, Chunk(columns, places))


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
        close = own[after] - own[after - 1] <= WIDEST_GAP * step
        known: NDArray[np.bool_] = close | (own[after] == time) | (own[after - 1] == time)
        return known

    def at(self, time: Array, held: Collection[str]) -> dict[str, Array]:
        """Returns the columns at other times: those ``held`` keep their last value, the others are interpolated."""
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


class Spool:
    """Appends rows of a fixed width to a file, and gives them back as one array on disk."""

    def __init__(self, path: Path, width: int) -> None:
        """Makes the file.

        Args:
            path: Of a temporary file.
            width: Numbers in a row.
        """
        self.rows = 0
        self._path = path
        self._width = width
        self._held: list[Sequence[float]] = []
        path.touch()

    def append(self, row: Sequence[float]) -> None:
        """Adds one row."""
        self._held.append(row)
        self.rows += 1
        if len(self._held) >= _BUFFERED:
            self._flush()

    def array(self) -> NDArray[np.float64]:
        """Returns all rows, (rows, width), read from disk as they are used."""
        self._flush()
        if not self.rows:
            return np.empty((0, self._width))
        return np.memmap(self._path, dtype=np.float64, mode="r", shape=(self.rows, self._width))

    def _flush(self) -> None:
        if self._held:
            with self._path.open("ab") as stream:
                np.array(self._held, dtype=np.float64).tofile(stream)
            self._held = []


def column_places(bag: BagFile) -> dict[str, tuple[str, str, str]]:
    """Returns column name -> (topic, field, joint) for what the first messages hold.

    Raises:
        BadInput: No message is about joints.
    """
    columns: dict[str, tuple[str, str, str]] = {}
    for message in first_messages(bag):
        for field in bag.topics[message.topic].fields:
            if len(message.numbers(field)) == len(message.names):
                for joint in message.names:
                    columns[f"{message.topic}.{field}.{joint}"] = (message.topic, field, joint)
    if not columns:
        types = ", ".join(bag.others) or "nothing"
        raise BadInput(
            f"{bag.path}: no message about joints (valid: sensor_msgs/JointState, or another type that lists joint"
            f" names and a number for each; present: {types})"
        )
    return columns


def first_messages(bag: BagFile) -> Iterator[JointMessage]:
    """Yields the first `PEEK` messages of each topic about joints."""
    for topic in bag.topics:
        for count, message in enumerate(bag.messages([topic]), start=1):
            yield message
            if count == PEEK:
                break


def _merge_note(base: Stream, others: Sequence[Stream]) -> str:
    listed = ", ".join(f"{stream.topic} ({stream.rows} messages)" for stream in others)
    return f"rows are the {base.rows} messages of {base.topic}; brought to their times: {listed}"
