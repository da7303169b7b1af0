# SPDX-License-Identifier: BSD-3-Clause
"""A ROS recording as one table: joints matched by name, whoever published them, on one clock.

The messages of one topic that list the same joints are a stream. The stream with most positions gives the
rows; the others are brought to its times: what was measured by interpolation, what was commanded by holding
the last command. Where a stream has a hole, no value is made up: its rows are left out.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_modules.episode.columns import TIME
from impedance_modules.episode.imports.bag_file import BagFile, JointMessage, open_bag
from impedance_modules.episode.imports.bag_streams import Stream, StreamSet
from impedance_modules.episode.imports.import_map import COMMANDS, TableMap
from impedance_modules.episode.imports.table import CHUNK_ROWS, Chunk, find_column, refuse_nonfinite
from impedance_modules.errors import BadInput

PEEK = 400
"""Messages of each topic that are looked at to learn which joints it lists."""


class BagTable:
    """One recording; its columns are called ``TOPIC.FIELD.JOINT``, and ``time`` [s] from the first row.

    Attributes:
        path, names, scalars, row_word, notes: See `Table`.
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
        """Yields the wanted columns; see `Table`."""
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
