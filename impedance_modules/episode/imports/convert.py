# SPDX-License-Identifier: BSD-3-Clause
"""Raw columns of one or several tables become joint quantities: units, signs, transmission, offsets, decimation."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import firwin, kaiserord, oaconvolve

from impedance_modules.episode.columns import JOINT_KINDS, TIME, joint_column
from impedance_modules.episode.imports.import_map import (
    EFFORTS,
    ImportMap,
    MappedQuantity,
    TableMap,
    efforts_at_joints,
    positions_at_joints,
)
from impedance_modules.episode.imports.log_checks import TURN, is_wrap
from impedance_modules.episode.imports.table import (
    CHUNK_ROWS,
    Block,
    Chunk,
    LogTable,
    Vector,
    even_chunks,
    find_column,
    refuse_nonfinite,
)
from impedance_modules.errors import BadFile, BadInput

SAME_TIME = 0.25
"""Fraction of a sampling period by which the times of two tables may differ in one row."""

ATTENUATION = 60.0
"""Of what would alias below half the new rate [dB]."""

WIDEST_PASS = 0.9
"""Largest pass band, as a fraction of half the new rate: a steeper filter distorts more of the log's ends."""

Matrix = NDArray[np.float64]

UNEVEN = 0.5
"""Fraction of a sampling period by which an evenly sampled time may be off."""


@dataclass(frozen=True, eq=False)
class MappedTable:
    """One table with its map.

    Attributes:
        table: Open.
        mapping: Its part of the map.
        time: Column of its time, or None.
        seconds: Of one unit of that column.
        wanted: All columns to read.
    """

    table: LogTable
    mapping: TableMap
    time: str | None
    seconds: float
    wanted: tuple[str, ...]


def map_table(table: LogTable, mapping: TableMap, document_of: ImportMap) -> MappedTable:
    """Finds a map's columns in its table.

    Raises:
        BadFile: The map names a column or variable that the table does not have.
    """
    time: str | None = None
    try:
        if mapping.time is not None and mapping.time.column is not None:
            time = find_column(table, mapping.time.column)
        elif table.row_word == "message":
            time = TIME
        references = [c for quantity in mapping.quantities for c in quantity.columns.values()]
        references += [column for column, _ in mapping.extra.values()]
        names = [find_column(table, reference) for reference in references]
        for quantity in mapping.quantities:
            _check_gain(table, quantity)
    except BadInput as error:
        raise BadFile(
            [document_of.document.problem(("tables", mapping.index), str(error), at="key")]
        ) from error
    wanted = tuple(dict.fromkeys([*([time] if time else []), *names]))
    seconds = mapping.time.seconds if mapping.time is not None else 1.0
    return MappedTable(table, mapping, time, seconds, wanted)


def blocks(parts: Sequence[MappedTable], mapping: ImportMap, rate: float | None) -> Iterator[Block]:
    """Yields a recording in the episode's columns, piece by piece.

    Args:
        parts: Its tables, row by row of one length.
        mapping: The import map.
        rate: Stated samples per second [Hz], for tables without time.

    Raises:
        BadInput: Tables of different lengths or times, or rows that cannot be read.
    """
    done = 0
    streams = [even_chunks(part.table.chunks(part.wanted), CHUNK_ROWS) for part in parts]
    for chunks in itertools.zip_longest(*streams):
        _check_lengths(parts, chunks, done)
        time = _time(parts, chunks, done, rate)
        columns: dict[str, Vector] = {}
        for part, chunk in zip(parts, chunks, strict=True):
            for quantity in part.mapping.quantities:
                columns.update(_joint_values(quantity, part, chunk, mapping))
            for name, (reference, scale) in part.mapping.extra.items():
                columns[name] = chunk.columns[find_column(part.table, reference)] * scale
        places = chunks[0].places
        done += len(places)
        ordered = {name: columns[name] for name in column_order(mapping)}
        refuse_nonfinite(parts[0].table.path, parts[0].table.row_word, Chunk({TIME: time, **ordered}, places))
        yield Block(time, ordered, places)


def column_order(mapping: ImportMap) -> tuple[str, ...]:
    """Returns the episode's columns without ``time``: kind by kind, joints in the map's order, extras last."""
    by_kind = {quantity.kind: quantity for table in mapping.tables for quantity in table.quantities}
    joints = [joint_column(kind, j) for kind in JOINT_KINDS if kind in by_kind for j in by_kind[kind].columns]
    return (*joints, *(name for table in mapping.tables for name in table.extra))


def decimated(blocks: Iterator[Block], mapping: ImportMap) -> Iterator[Block]:
    """Yields every n-th sample of the filtered recording, at its own time.

    A symmetric FIR filter (Kaiser window) of odd length delays nothing; beyond its ends the recording is
    continued by its point reflection, 2 x_0 - x_i, which keeps value and slope.

    Raises:
        BadFile: The pass band does not fit below half the new rate.
        BadInput: Uneven samples, or fewer than the filter is long.
    """
    decimation = mapping.decimation
    if decimation is None:
        yield from blocks
        return
    blocks = unwrapped(blocks, mapping)
    first = next(blocks, None)
    if first is None:
        return
    taps = _filter(first, mapping)
    half = len(taps) // 2
    if len(first.time) <= half:
        raise BadInput(
            f"{mapping.document.path}: decimate: the filter needs {half + 1} samples, and there are {len(first.time)}"
            " (valid: a longer log, a smaller 'low_pass', or no 'decimate')"
        )
    step = float(np.median(np.diff(first.time)))
    _check_even(first.time, step, mapping)
    window = _Window(tuple(first.columns), taps, decimation.keep_every)
    window.add(_mirrored(_matrix(first)[: half + 1], head=True))
    window.add(_matrix(first), first)
    for block in blocks:
        _check_even(np.concatenate([window.times[-1:], block.time]), step, mapping)
        window.add(_matrix(block), block)
        yield window.filtered()
    window.add(_mirrored(window.values[-half - 1 :], head=False))
    yield window.filtered()


def unwrapped(blocks: Iterator[Block], mapping: ImportMap) -> Iterator[Block]:
    """Yields positions without the jumps of angles that are counted from zero again after a turn.

    A low-pass would make a motion of each jump.
    """
    turning = [joint_column("position", j) for j in mapping.joints if j not in mapping.prismatic]
    last: dict[str, float] = {}
    wrapped_turns: dict[str, float] = {}
    for block in blocks:
        columns = dict(block.columns)
        for name in turning:
            if name in columns:
                steps = np.diff(columns[name], prepend=last.get(name, columns[name][0]))
                turns = np.where(is_wrap(steps), np.round(steps / TURN), 0.0)
                last[name] = float(columns[name][-1])
                total = wrapped_turns.get(name, 0.0) + np.cumsum(turns)
                columns[name] = columns[name] - TURN * total
                wrapped_turns[name] = float(total[-1])
        yield Block(block.time, columns, block.places)


class _Window:
    """The samples that are in memory; ``values`` reaches half a filter beyond ``times`` on both sides."""

    def __init__(self, names: tuple[str, ...], taps: Matrix, keep_every: int) -> None:
        self.values = np.empty((0, len(names)))
        self.times = np.empty(0)
        self._places = np.empty(0, dtype=np.int64)
        self._names = names
        self._taps = taps
        self._keep_every = keep_every
        self._next = 0

    def add(self, values: Matrix, of: Block | None = None) -> None:
        """Appends samples, or, without a block, what lies beyond an end of the recording."""
        self.values = np.vstack([self.values, values])
        if of is not None:
            self.times = np.concatenate([self.times, of.time])
            self._places = np.concatenate([self._places, of.places])

    def filtered(self) -> Block:
        """Filters what has neighbours on both sides, keeps every n-th sample of it, and forgets the rest."""
        ready = len(self.values) - len(self._taps) + 1
        smooth = oaconvolve(self.values, self._taps[:, None], mode="valid", axes=0)
        keep = slice(self._next, ready, self._keep_every)
        columns = {name: smooth[keep, index].copy() for index, name in enumerate(self._names)}
        block = Block(self.times[:ready][keep], columns, self._places[:ready][keep])
        self._next = (self._next - ready) % self._keep_every
        self.values, self.times, self._places = self.values[ready:], self.times[ready:], self._places[ready:]
        return block


def _check_gain(table: LogTable, quantity: MappedQuantity) -> None:
    gain = quantity.gain_variable
    if gain is not None and gain not in table.scalars:
        present = ", ".join(table.scalars) or "none"
        raise BadInput(f"{table.path}: no variable '{gain}' with a single number (present: {present})")


def _check_lengths(parts: Sequence[MappedTable], chunks: Sequence[Chunk | None], done: int) -> None:
    lengths = [0 if chunk is None else len(chunk) for chunk in chunks]
    if len(set(lengths)) > 1:
        short = int(np.argmin(lengths))
        other = next(i for i, length in enumerate(lengths) if length > lengths[short])
        raise BadInput(
            f"{parts[short].table.path}: ends after {done + lengths[short]} rows, and {parts[other].table.path} goes"
            " on (valid: tables of one recording have one length and one rate)"
        )


def _time(parts: Sequence[MappedTable], chunks: Sequence[Chunk], done: int, rate: float | None) -> Vector:
    """The time of each row: the first table's that has one, else even steps."""
    found: Vector | None = None
    first: MappedTable | None = None
    for part, chunk in zip(parts, chunks, strict=True):
        if part.time is None:
            continue
        time = chunk.columns[part.time] * part.seconds
        if found is None or first is None:
            found, first = time, part
            continue
        step = np.median(np.diff(found)) if len(found) > 1 else 0.0
        apart = np.abs(time - found) > SAME_TIME * step
        if apart.any():
            row = int(np.argmax(apart))
            raise BadInput(
                f"{part.table.path}:{chunk.places[row]}: the time here is {time[row]:.6g} s, and {found[row]:.6g} s"
                f" in the same row of {first.table.path} (valid: tables that were recorded together, at one rate)"
            )
    if found is not None:
        return found
    if rate is None:
        raise BadInput(f"{parts[0].table.path}: no time base (valid: a time column in the map, or a rate)")
    return np.arange(done, done + len(chunks[0])) / rate


def _joint_values(
    quantity: MappedQuantity, part: MappedTable, chunk: Chunk, mapping: ImportMap
) -> Mapping[str, Vector]:
    joints = tuple(quantity.columns)
    values: NDArray[np.float64] = np.column_stack(
        [chunk.columns[find_column(part.table, column)] for column in quantity.columns.values()]
    ) * np.array([quantity.scale[joint] for joint in joints])
    if quantity.gain_variable is not None:
        values = values * part.table.scalars[quantity.gain_variable]
    if quantity.motor_side and mapping.transmission is not None:
        carry = efforts_at_joints if quantity.kind in EFFORTS else positions_at_joints
        values = carry(mapping.transmission, values)
    values = values + np.array([quantity.offset.get(joint, 0.0) for joint in joints])
    return {joint_column(quantity.kind, joint): values[:, i].copy() for i, joint in enumerate(joints)}


def _filter(first: Block, mapping: ImportMap) -> Matrix:
    """Designs the filter: pass band up to ``low_pass``, stop band from half the new rate."""
    decimation = mapping.decimation
    if decimation is None or len(first.time) < 2:
        raise BadInput(f"{mapping.document.path}: decimate: a single sample cannot be decimated")
    rate = 1.0 / float(np.median(np.diff(first.time)))
    edge = 0.5 * rate / decimation.keep_every
    if decimation.low_pass > WIDEST_PASS * edge:
        message = (
            f"{decimation.low_pass:g} Hz at {rate:g} Hz and every {decimation.keep_every}th sample: at most"
            f" {WIDEST_PASS * edge:g} Hz fit"
        )
        raise BadFile([mapping.document.problem(("decimate", "low_pass"), message)])
    taps, beta = kaiserord(ATTENUATION, (edge - decimation.low_pass) / (0.5 * rate))
    window = ("kaiser", beta)
    designed: Matrix = firwin(taps | 1, 0.5 * (edge + decimation.low_pass), window=window, fs=rate)
    return designed


def _matrix(block: Block) -> Matrix:
    values: Matrix = np.column_stack(list(block.columns.values()))
    return values


def _mirrored(part: Matrix, *, head: bool) -> Matrix:
    """The point reflection of ``half + 1`` samples about the outermost, which itself is left out."""
    mirrored: Matrix = 2.0 * part[0] - part[:0:-1] if head else 2.0 * part[-1] - part[-2::-1]
    return mirrored


def _check_even(time: Matrix, step: float, mapping: ImportMap) -> None:
    off = np.abs(np.diff(time) - step) > UNEVEN * step
    if off.any():
        row = int(np.argmax(off))
        raise BadInput(
            f"{mapping.document.path}: decimate: the samples are not even: {np.diff(time)[row]:.4g} s after"
            f" t = {time[row]:.6g} s, where {step:.4g} s is usual (valid: even samples, or no 'decimate')"
        )
