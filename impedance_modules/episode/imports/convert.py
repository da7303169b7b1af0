# SPDX-License-Identifier: BSD-3-Clause
"""Turns the raw columns of one or several tables into joint quantities: units, signs, transmission, offsets."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.episode.columns import JOINT_KINDS, TIME, joint_column
from impedance_modules.episode.imports.blocks import Block, Vector
from impedance_modules.episode.imports.import_map import EFFORTS, ImportMap, Quantity, TableMap
from impedance_modules.episode.imports.table import (
    CHUNK_ROWS,
    Chunk,
    Table,
    even_chunks,
    find_column,
    refuse_nonfinite,
)
from impedance_modules.episode.imports.transmission import efforts_at_joints, positions_at_joints
from impedance_modules.errors import BadFile, BadInput

SAME_TIME = 0.25
"""Part of a step by which the times of two tables may differ in one row."""


@dataclass(frozen=True, eq=False)
class Part:
    """One table with its map.

    Attributes:
        table: Open.
        what: Its part of the map.
        time: Column of its time, or None.
        seconds: Of one unit of that column.
        wanted: All columns to read.
    """

    table: Table
    what: TableMap
    time: str | None
    seconds: float
    wanted: tuple[str, ...]


def make_part(table: Table, what: TableMap, document_of: ImportMap) -> Part:
    """Finds a map's columns in its table.

    Raises:
        BadFile: The map names a column or variable that the table does not have.
    """
    time: str | None = None
    try:
        if what.time is not None and what.time.column is not None:
            time = find_column(table, what.time.column)
        elif table.row_word == "message":
            time = TIME
        references = [c for quantity in what.quantities for c in quantity.columns.values()]
        references += [column for column, _ in what.extra.values()]
        names = [find_column(table, reference) for reference in references]
        for quantity in what.quantities:
            _check_gain(table, quantity)
    except BadInput as error:
        raise BadFile([document_of.document.problem(("tables", what.index), str(error), at="key")]) from error
    wanted = tuple(dict.fromkeys([*([time] if time else []), *names]))
    seconds = what.time.seconds if what.time is not None else 1.0
    return Part(table, what, time, seconds, wanted)


def _check_gain(table: Table, quantity: Quantity) -> None:
    gain = quantity.gain_variable
    if gain is not None and gain not in table.scalars:
        present = ", ".join(table.scalars) or "none"
        raise BadInput(f"{table.path}: no variable '{gain}' with a single number (present: {present})")


def blocks(parts: Sequence[Part], what: ImportMap, rate: float | None) -> Iterator[Block]:
    """Yields a recording in the episode's columns, piece by piece.

    Args:
        parts: Its tables, row by row of one length.
        what: The map.
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
            for quantity in part.what.quantities:
                columns.update(_joint_values(quantity, part, chunk, what))
            for name, (reference, scale) in part.what.extra.items():
                columns[name] = chunk.columns[find_column(part.table, reference)] * scale
        places = chunks[0].places
        done += len(places)
        ordered = {name: columns[name] for name in column_order(what)}
        refuse_nonfinite(parts[0].table.path, parts[0].table.row_word, Chunk({TIME: time, **ordered}, places))
        yield Block(time, ordered, places)


def column_order(what: ImportMap) -> tuple[str, ...]:
    """Returns the episode's columns without ``time``: kind by kind, joints in the map's order, extras last."""
    by_kind = {quantity.kind: quantity for table in what.tables for quantity in table.quantities}
    joints = [joint_column(kind, j) for kind in JOINT_KINDS if kind in by_kind for j in by_kind[kind].columns]
    return (*joints, *(name for table in what.tables for name in table.extra))


def _check_lengths(parts: Sequence[Part], chunks: Sequence[Chunk | None], done: int) -> None:
    lengths = [0 if chunk is None else len(chunk) for chunk in chunks]
    if len(set(lengths)) > 1:
        short = int(np.argmin(lengths))
        other = next(i for i, length in enumerate(lengths) if length > lengths[short])
        raise BadInput(
            f"{parts[short].table.path}: ends after {done + lengths[short]} rows, and {parts[other].table.path} goes"
            " on (valid: tables of one recording have one length and one rate)"
        )


def _time(parts: Sequence[Part], chunks: Sequence[Chunk], done: int, rate: float | None) -> Vector:
    """The time of each row: the first table's that has one, else even steps."""
    found: Vector | None = None
    first: Part | None = None
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


def _joint_values(quantity: Quantity, part: Part, chunk: Chunk, what: ImportMap) -> Mapping[str, Vector]:
    joints = tuple(quantity.columns)
    values: NDArray[np.float64] = np.column_stack(
        [chunk.columns[find_column(part.table, column)] for column in quantity.columns.values()]
    ) * np.array([quantity.scale[joint] for joint in joints])
    if quantity.gain_variable is not None:
        values = values * part.table.scalars[quantity.gain_variable]
    if quantity.motor_side and what.transmission is not None:
        carry = efforts_at_joints if quantity.kind in EFFORTS else positions_at_joints
        values = carry(what.transmission, values)
    values = values + np.array([quantity.offset.get(joint, 0.0) for joint in joints])
    return {joint_column(quantity.kind, joint): values[:, i].copy() for i, joint in enumerate(joints)}
